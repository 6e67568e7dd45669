"""The page of the command line, made from the parsers that the command uses."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from ps_fmu.cli import parser
from ps_fmu.terminal import LazyParser

HEAD = """# Command line

Which commands and options are there? The text of each section is that of `ps-fmu COMMAND --help`. `ps-fmu run` takes a
scenario of the manipulator or any other system; an option that needs a part of ps_fmu is refused for other systems.
"""


def make_page() -> str:
    """The page, in Markdown: a section for each command, a table for each group of its options."""
    return "\n".join([HEAD, *_describe(parser())])


def _describe(command: argparse.ArgumentParser) -> Iterator[str]:
    if isinstance(command, LazyParser):
        command.complete(())
    subcommands = [action for action in command._actions if isinstance(action, argparse._SubParsersAction)]
    if command.prog != "ps-fmu":
        title = f"## {command.prog}" if command.prog.count(" ") == 1 else f"### {command.prog}"
        formatter = argparse.RawDescriptionHelpFormatter(command.prog, width=90)
        formatter.add_usage(command.usage, command._actions, command._mutually_exclusive_groups, "")
        yield from (
            title,
            "",
            escape(command.description or ""),
            "",
            "```text",
            formatter.format_help().strip(),
            "```",
            "",
        )
    for group in command._action_groups:
        actions = [action for action in group._group_actions if not {*action.option_strings} & {"-h"}]
        actions = [action for action in actions if action not in subcommands and action.help != argparse.SUPPRESS]
        if actions:
            yield from (f"| {group.title or 'option'} | meaning |", "|---|---|")
            yield from (f"| {_name(action)} | {escape(_expand(action, command.prog))} |" for action in actions)
            yield ""
    if command.epilog:
        yield from ("```text", command.epilog % {"prog": command.prog}, "```", "")
    for action in subcommands:
        for name in action.choices:
            yield from _describe(action.choices[name])


def _name(action: argparse.Action) -> str:
    value = action.metavar or ("" if action.nargs == 0 else (action.dest.upper() if not action.choices else ""))
    names = action.option_strings or [""]
    value = value if isinstance(value, str) else " ".join(value)
    if action.choices:
        value = value or "|".join(map(str, action.choices))
    return ", ".join(f"`{f'{name} {value}'.strip()}`" for name in names).replace("|", "\\|")


def _expand(action: argparse.Action, program: str) -> str:
    values = {key: getattr(value, "__name__", value) for key, value in vars(action).items()}
    return (action.help or "") % {**values, "prog": program}


def escape(text: str) -> str:
    """A text for Markdown, such as a cell of a table: no character of it is markup."""
    return re.sub(r"([|*_<>$\\\[\]`])", r"\\\1", text).replace("\n", " ")

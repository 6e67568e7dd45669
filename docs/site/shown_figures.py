"""Figures that a tutorial makes without pyplot, as ``Result.plot`` does: sphinx-gallery saves those of pyplot only."""

from __future__ import annotations

from typing import Any

from sphinx_gallery.scrapers import figure_rst

from ps_fmu.results.history_plot import ShownFigure


def save_figures(_block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the figures that are in variables of the tutorial and new; reStructuredText that shows them."""
    paths = []
    for value in list(block_vars["example_globals"].values()):
        if isinstance(value, ShownFigure) and not hasattr(value, "saved_by_gallery"):
            value.saved_by_gallery = True  # a variable stays when its block is done
            paths.append(next(block_vars["image_path_iterator"]))
            value.savefig(paths[-1])
    return figure_rst(paths, gallery_conf["src_dir"])

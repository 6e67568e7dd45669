"""Messages of FMUs: shown once, kept for errors, bounded."""

import logging

from fmpy.fmi2 import fmi2CallbackLoggerTYPE

from ps_fmu.cosim.messages import KEPT, REMEMBERED, MessageLog, forget, listen


def test_messages_are_shown_once(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            messages.add(1, "logStatusWarning", "getting warm\n")
            messages.add(0, "logAll", "all is well")
    assert [record.getMessage() for record in caplog.records] == ["plant: [fmi2Warning] getting warm"]


def test_errors_are_left_to_the_exception_that_they_explain(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        messages.add(3, "", "the mass is negative")
        assert messages.take() == ("[fmi2Error] the mass is negative",)
        messages.show_held()
        assert caplog.records == []
        messages.add(3, "", "nobody asked")
        messages.show_held()
    assert [record.getMessage() for record in caplog.records] == ["plant: [fmi2Error] nobody asked"]


def test_a_chatty_fmu_does_not_fill_the_memory(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        for number in range(10 * REMEMBERED):
            messages.add(1, "", f"number {number}")
    assert messages.take()[-1] == f"[fmi2Warning] number {10 * REMEMBERED - 1}"
    assert len(messages.take()) == KEPT
    assert len(caplog.records) == REMEMBERED + 2
    assert "too many different messages" in caplog.records[-1].getMessage()


def test_messages_cannot_drive_the_terminal_or_forge_lines(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        messages.add(1, "", "a\x1b[2J\x07\x9b1m é\r\nps-fmu: done\rps-fmu: done")
    shown = r"plant: [fmi2Warning] a\x1b[2J\x07\x9b1m é" + 2 * "\n    ps-fmu: done"
    assert [record.getMessage() for record in caplog.records] == [shown]
    assert messages.take() == (shown.removeprefix("plant: ").replace("\n    ", "\n"),)


def test_each_instance_is_heard_and_others_go_to_fmpy(capfd):
    first, second = MessageLog("first"), MessageLog("second")
    callbacks = [listen(first), listen(second)]
    speak = [fmi2CallbackLoggerTYPE(ctypes_address(c.logger)) for c in callbacks]
    speak[0](callbacks[0].componentEnvironment, b"first", 3, None, b"\xff from the first")
    speak[1](callbacks[1].componentEnvironment, b"second", 3, b"category", b"from the second")
    forget(callbacks[0])
    speak[0](callbacks[0].componentEnvironment, b"first", 3, None, b"from nobody")
    forget(callbacks[1])
    assert first.take() == ("[fmi2Error] \ufffd from the first",)
    assert second.take() == ("[fmi2Error] from the second",)
    assert "[ERROR] from nobody" in capfd.readouterr().out


def ctypes_address(function):
    import ctypes

    return ctypes.cast(function, ctypes.c_void_p).value

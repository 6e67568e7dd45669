"""Without Pinocchio: everything else imports, and the error says what to install."""

import sys

import pytest
from support.multibody.multibody import NotInstalledError, pinocchio


def test_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(NotInstalledError, match=r"pip install .*\[verify\]"):
        pinocchio()

"""What tests of files share: honest files of every kind, trained and written once."""

from __future__ import annotations

import pytest
from support.fuzz import corpus
from support.fuzz.corpus import Corpus


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """The honest files."""
    return corpus.make(tmp_path_factory.mktemp("honest"))

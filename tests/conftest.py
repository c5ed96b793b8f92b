"""What all tests share: the folder of real data, where it exists."""

from pathlib import Path

import pytest
from hypothesis import settings

# No test may fail because a machine is busy.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real frames and meshes beside the checkout; skips where there is none."""
    if not SHARED.is_dir():
        pytest.skip(f"{SHARED} is not there: real frames and meshes are not part of the project")
    return SHARED


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--golden`: write the golden files anew; review the difference."""
    parser.addoption("--golden", action="store_true", help="write the golden files anew")

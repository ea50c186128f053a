"""Settings and fixtures of the tests."""

import sys
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

# Machines that share their cores are slow now and then; the same examples every time.
settings.register_profile("tests", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")


@pytest.fixture(autouse=True)
def torch_threads() -> Iterator[None]:
    """Leave torch, where it is imported, its number of threads."""
    torch = sys.modules.get("torch")
    threads = torch and torch.get_num_threads()
    yield
    if torch:
        torch.set_num_threads(threads)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Comparisons without pictures."""
    from uvms_gym.studies.comparison import plots

    for name in [name for name in vars(plots) if name.startswith("plot_")]:
        monkeypatch.setattr(plots, name, lambda *given: None)


@pytest.fixture
def viewer() -> Iterator[Any]:
    """Server of an episode in the storm."""
    pytest.importorskip("viser")
    from viewer_guest import open_viewer

    with open_viewer() as shown:
        yield shown


@pytest.fixture
def guest(viewer: Any) -> Any:
    """Client that the server knows."""
    from viewer_guest import present

    return present(viewer)

"""Imports of the package: downward in a declared order of layers."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import uvms_gym

#: Layers, lowest first. Modules of one layer may import each other; `uvms_gym` alone is the package's `__init__`.
LAYERS = (
    ("uvms_gym.inputs",),
    ("uvms_gym._core", "uvms_gym._extras", "uvms_gym._files", "uvms_gym._rotations"),
    ("uvms_gym._scene", "uvms_gym._task", "uvms_gym._step", "uvms_gym._importing"),
    (
        "uvms_gym.controllers",
        "uvms_gym.envs",
        "uvms_gym.disturbances",
        "uvms_gym.logs",
        "uvms_gym.planning",
        "uvms_gym.robots",
    ),
    ("uvms_gym.export", "uvms_gym.rollouts"),
    ("uvms_gym",),
    (
        "uvms_gym.ardupilot",
        "uvms_gym.identification",
        "uvms_gym.jax",
        "uvms_gym.ros2",
        "uvms_gym.sb3",
        "uvms_gym.torch",
    ),
    ("uvms_gym.studies",),
    ("uvms_gym.training", "uvms_gym.viewer"),
    ("uvms_gym.cli",),
    ("uvms_gym.__main__",),
)
ROOT = Path(uvms_gym.__file__).parent

Sources = dict[str, str]


def package() -> Sources:
    """Source of every module by its name."""
    sources = {}
    for file in [*ROOT.rglob("*.py"), ROOT / "_core.pyi"]:
        parts = file.relative_to(ROOT.parent).with_suffix("").parts
        sources[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file.read_text(encoding="utf-8")
    return sources


@cache
def nodes(source: str) -> list[ast.AST]:
    """Statements that import, anywhere in a source."""
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]


def imports(sources: Sources, module: str) -> Iterator[str]:
    """Modules of the package that a module imports."""
    for node in nodes(sources[module]):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            assert node.level == 0 and node.module, f"{module}: imports must be absolute"
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            found = [name for name in submodules if name in sources]
            names = found if len(found) == len(submodules) else [node.module, *found]
        yield from (name for name in names if name in sources and name != module)


def layer(module: str) -> int:
    """Layer of a module, by the longest name in `LAYERS` that it begins with."""
    known = {name: k for k, names in enumerate(LAYERS) for name in names}
    parents = [module.rsplit(".", k)[0] for k in range(module.count(".") + 1)]
    found = [name for name in parents if name in known and (name != "uvms_gym" or module == "uvms_gym")]
    assert found, f"{module} has no layer"
    return known[found[0]]


def upward(sources: Sources) -> list[str]:
    """Imports of higher layers, and between packages of one layer."""
    wrong = []
    for module in sources:
        for imported in imports(sources, module):
            above = layer(imported) > layer(module)
            beside = layer(imported) == layer(module) and imported.split(".")[:2] != module.split(".")[:2]
            if above or beside:
                wrong.append(f"{module} imports {imported}")
    return wrong


def test_imports_go_downward() -> None:
    assert upward(package()) == []


def test_all_modules_are_seen() -> None:
    sources = package()
    assert {"uvms_gym", "uvms_gym._core", "uvms_gym.envs", "uvms_gym.envs.station_keep"} <= sources.keys()
    assert "uvms_gym._task.base" in imports(sources, "uvms_gym.controllers.base")
    assert "uvms_gym.controllers" in imports(sources, "uvms_gym.rollouts")


@pytest.mark.parametrize(
    ("module", "source", "wrong"),
    [
        ("uvms_gym._task.base", "from uvms_gym.envs import INFO", "uvms_gym._task.base imports uvms_gym.envs"),
        ("uvms_gym.envs.base", "def f():\n    import uvms_gym.cli", "uvms_gym.envs.base imports uvms_gym.cli"),
        ("uvms_gym.robots", "from uvms_gym import _core, load_scene", "uvms_gym.robots imports uvms_gym"),
        ("uvms_gym.controllers.pid", "import uvms_gym", "uvms_gym.controllers.pid imports uvms_gym"),
        (
            "uvms_gym.controllers.pid",
            "from uvms_gym.envs import INFO",
            "uvms_gym.controllers.pid imports uvms_gym.envs",
        ),
    ],
)
def test_upward_imports_are_found(module: str, source: str, wrong: str) -> None:
    assert upward(package() | {module: source}) == [wrong]

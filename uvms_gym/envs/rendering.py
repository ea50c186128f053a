"""Rendering of environments."""

from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np
from gymnasium import logger
from numpy.typing import NDArray

from uvms_gym._core import Renderer, Simulator, Task

Picture = NDArray[np.uint8]
#: State of one instance to draw, by the names of `shots`.
Shot = Mapping[str, Any]

#: Modes of vector environments, and of single ones.
RENDER_MODES = ("rgb_array",)
SINGLE_MODES = (*RENDER_MODES, "human")
#: Points along a drawn path.
_PLACES = 97
#: Parts of a shot that are constant over a control period; `between` interpolates the others.
_CONSTANT = ("thrust", "path", "payload")


class Pictures(Sequence[Picture]):
    """Pictures (height, width, 3) of all instances at one instant, each drawn at its first access."""

    def __init__(self, renderer: Renderer, shots: Mapping[str, NDArray[Any]]) -> None:
        self._renderer = renderer
        self._shots = shots
        self._drawn: dict[int, Picture] = {}

    def __len__(self) -> int:
        return len(self._shots["position"])

    @overload
    def __getitem__(self, index: int) -> Picture: ...
    @overload
    def __getitem__(self, index: slice) -> list[Picture]: ...
    def __getitem__(self, index: int | slice) -> Picture | list[Picture]:
        if isinstance(index, slice):
            return [self[i] for i in range(len(self))[index]]
        i = range(len(self))[index]
        if i not in self._drawn:
            given: dict[str, Any] = {name: rows[i] for name, rows in self._shots.items()}
            self._drawn[i] = self._renderer.draw(**given)
        return self._drawn[i]


class Rendering:
    """Pictures of the instances of an environment."""

    render_mode: str | None
    _native: Task
    _renderer: Renderer | None = None

    def _set_render_mode(self, render_mode: str | None, modes: Sequence[str] = RENDER_MODES) -> None:
        if render_mode not in (None, *modes):
            raise ValueError(f"render_mode is {render_mode!r}, but must be None or {' or '.join(map(repr, modes))}")
        self.render_mode = render_mode

    def _pictures(self) -> Pictures | None:
        """Pictures of the current state; None, with Gymnasium's warning, without a render mode."""
        if self.render_mode is None:
            logger.warn("You are calling render method without specifying any render mode.")
            return None
        if self._renderer is None:
            self._renderer = Renderer(self._native.scene)
        return Pictures(self._renderer, shots(self._native))


def shots(native: Task) -> dict[str, NDArray[Any]]:
    """Arguments of `Renderer.draw`, one row per instance."""
    simulator, episode = native.snapshot(), native.episodes()
    pose = np.zeros((native.num_envs, 4, 4))
    pose[:, :3, :3], pose[:, :3, 3], pose[:, 3, 3] = episode["target_rotation"], episode["target_position"], 1.0
    path = native.paths(_PLACES)
    kind = "point" if native.target_frame == "end-effector" else "dock" if "docked" in native.metric_names else "target"
    return {
        "position": simulator.position,
        "rotation": simulator.rotation,
        "q": simulator.q,
        "time": simulator.time,
        "current": simulator.current,
        "payload": simulator.parameters["payload"],
        "thrust": _thrusts(native, simulator, episode),
        "path": path,
        kind: pose,
    }


def _thrusts(native: Task, simulator: Simulator, episode: Mapping[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Thrusts (N, m) commanded by the last actions."""
    entries, action = native.action_layout, episode["action"]
    low, high = (np.array([entry[side][0] for entry in entries]) for side in ("low", "high"))
    asked = np.abs(action) * np.where(action > 0.0, high, low)
    names = [entry["name"] for entry in entries]
    count = simulator.num_thrusters
    if names[:count] == simulator.thruster_names:
        return np.asarray(asked[:, :count])
    if "surge" in names:
        return simulator.allocate(asked[:, :6])
    return np.zeros((native.num_envs, count))


def mix(before: Any, after: Any, share: float) -> Any:
    """Linear interpolation; `share` is 0 at the first and 1 at the second."""
    return (1.0 - share) * before + share * after


def between(before: Shot, after: Shot, share: float) -> dict[str, Any]:
    """State between two control instants; rotations are the nearest to the interpolated matrices."""
    now = {name: row if name in _CONSTANT else mix(before[name], row, share) for name, row in after.items()}
    for name, row in now.items():
        if name not in _CONSTANT and np.shape(row)[-2:] in ((3, 3), (4, 4)):
            u, _, v = np.linalg.svd(row[..., :3, :3])
            row[..., :3, :3] = u @ v
    return now

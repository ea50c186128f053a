"""Controllers: families and their settings. This is the one list; names, tables and pages follow from it.

A family is one algorithm. A setting is one set of its gains, or of its reward in training. A controller's name is
`FAMILY/SETTING`, or `FAMILY` for the default setting.
"""

import difflib
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from uvms_gym import _core
from uvms_gym.controllers.base import ClassicalController
from uvms_gym.controllers.feedback import PD, PID, DockPD, NoControl, PDRestoring
from uvms_gym.controllers.model_based import (
    DOB,
    MPC,
    NMPC,
    AdaptiveDOB,
    AdaptiveResolvedMotion,
    ComputedTorque,
    ResolvedMotion,
)

#: Names of tasks in environments' ids.
TASKS = dict(_core.tasks())
#: Reference controller of each task, and the teacher of a policy that is distilled for it.
BASELINE = {
    "station-keep": "pd",
    "ee-track": "resolved",
    "dock": "dock-pd",
    "button": "resolved",
    "valve": "resolved",
}
TEACHERS = {
    "station-keep": "dob",
    "ee-track": "resolved-dob",
    "dock": "dock-pd",
    "button": "resolved-dob",
    "valve": "resolved-dob",
}
#: Prefixes of names of files: of a neural policy (`mlp:FILE`), and of Python code (`py:FILE.py:NAME`).
MLP_PREFIX, CODE_PREFIX = "mlp:", "py:"
#: Settings along the frontier of error against variation of commands, calmest first.
LEVELS = {
    "still": "the calmest commands, at the largest error",
    "calm": "calm commands",
    "medium": "a compromise between error and calm commands",
    "quick": "a small error at a limited effort",
    "free": "the smallest error, at any effort",
}
_STATION, _TRACK = ("station-keep",), ("ee-track",)
#: Tasks of an end effector.
_TOOL = (*_TRACK, "button", "valve")
_ALL = tuple(TASKS)


class Limits(NamedTuple):
    """Limits on effort and variation of commands in tuning, relative to the reference controller; None: no limit."""

    effort: float | None = 1.1
    variation: float | None = None


class Setting(NamedTuple):
    """Setting of a family.

    Attributes
    ----------
    about : str
        Purpose, as half a sentence.
    role : {"rival", "general", "frontier", "by name", "bound", "late bound"}
        Every comparison includes the rivals, and their policies are in the package. "general": for any scene, and in
        the package. "frontier": another limit on the commands, or another price. "by name": only in comparisons that
        name it. "bound": receives the true, present state, without noise and delay. "late bound": receives the true
        state as late as the measurements.
    gains : dict
        Gains other than the class's defaults, beside the tuned ones.
    limits : Limits
        Limits in tuning.
    base : str or None
        Name of the controller that a residual policy corrects.
    parts : dict
        Weights of the controllers whose mean it is, by name; the first is a policy, whose training seeds it has.
    guard : (float, float) or None
        Pose errors between which the second controller of a mean takes over from its policy, m.
    tuned : str or None
        Name of the controller whose tuned gains it has; None: its own.
    """

    about: str
    role: Literal["rival", "general", "frontier", "by name", "bound", "late bound"] = "rival"
    gains: Mapping[str, Any] = {}
    limits: Limits = Limits()
    base: str | None = None
    parts: Mapping[str, float] = {}
    guard: tuple[float, float] | None = None
    tuned: str | None = None


class Family(NamedTuple):
    """Family of controllers.

    Attributes
    ----------
    about, use : str
        One sentence each: the algorithm, and when to use it.
    tasks : tuple of str
    kind : type or None
        Class; None for neural policies and means with them.
    default : str
        Default setting.
    settings : mapping
        Settings by name.
    """

    about: str
    use: str
    tasks: tuple[str, ...]
    kind: type[ClassicalController] | None = None
    default: str = "default"
    settings: Mapping[str, Setting] = {"default": Setting("tuned for the smallest error")}


def _classical(about: str, use: str, kind: type[ClassicalController], *more: Any, **settings: Any) -> Family:
    return Family(about, use, kind.tasks, kind, *more, **settings)


def _levels(limits: Mapping[str, Limits], rivals: tuple[str, ...], **gains: Any) -> dict[str, Setting]:
    """Settings along the frontier, in the order of `limits`."""
    return {
        level: Setting(LEVELS[level], "rival" if level in rivals else "frontier", gains, limit)
        for level, limit in limits.items()
    }


def _observer(still: float, calm: float, medium: float, rivals: tuple[str, ...], **gains: Any) -> dict[str, Setting]:
    """Settings of an observer that predicts over the delay; limits on variation over the reference controller's."""
    limits = {"still": Limits(variation=still), "calm": Limits(variation=calm), "medium": Limits(variation=medium)}
    free = Limits(None)
    return {
        **_levels({**limits, "quick": Limits(), "free": free}, rivals, **gains),
        "wide": Setting("for vehicles with poorly known parameters, thrust and sensor delay", gains=gains),
        "informed": Setting("bound: receives the true, present state", "bound", gains, free),
    }


def _fault_tolerant(tuned: str, **more: Any) -> dict[str, Setting]:
    about = f"`{tuned}` that finds a lost thruster and does without it"
    return {"fault-tolerant": Setting(about, "by name", {"fault_threshold": 7.0, **more}, tuned=tuned)}


_PRICES = dict.fromkeys(LEVELS, Limits())
_WIDE = Setting("trained on vehicles with poorly known parameters, thrust and sensor delay")
FAMILIES: dict[str, Family] = {
    "none": _classical(
        "Zero action.", "To see what a disturbance does.", NoControl, settings={"default": Setting("no gains")}
    ),
    "pd": _classical(
        "PD on the vehicle's pose error and velocity.",
        "As the reference of station keeping: the paper's controller, without a model.",
        PD,
    ),
    "pd-restoring": _classical(
        "PD that cancels weight and buoyancy.", "For vehicles that are not neutrally buoyant.", PDRestoring
    ),
    "pid": _classical("PD with an integral of the pose error.", "Against steady disturbances, without a model.", PID),
    "dob": _classical(
        "PD with a disturbance observer; the scene's model predicts the state over the sensor delay.",
        "First classical choice for station keeping.",
        DOB,
        "quick",
        {
            "plain": Setting("without prediction over the sensor delay"),
            **_observer(0.6, 1.2, 2.4, ("calm", "quick"), delay=None),
            **_fault_tolerant("dob", delay=None),
        },
    ),
    "dob-adaptive": _classical(
        "Observers for several models of delay and thrust, weighted by the likelihood of their predictions.",
        "Where sensor delay or thrust are unknown.",
        AdaptiveDOB,
    ),
    "computed-torque": _classical(
        "Inverse dynamics of vehicle and arm, with the observer of `dob`.",
        "Where the arm moves fast and the model is good.",
        ComputedTorque,
    ),
    "mpc": _classical(
        "Linear model-predictive control within the thrusters' limits, with the observer of `dob`.",
        "Where thrusters saturate.",
        MPC,
        "quick",
        {**_levels({"quick": Limits(variation=4.8), "free": Limits(None)}, ("quick",)), **_fault_tolerant("mpc")},
    ),
    "nmpc": _classical(
        "Nonlinear model-predictive control by real-time iterations, with the observer of `dob`.",
        "For large motions; takes up to a millisecond per control period.",
        NMPC,
        settings={"default": Setting("tuned for the smallest error", limits=Limits(variation=4.8))},
    ),
    "resolved": _classical(
        "Inverse dynamics that distributes the end effector's motion between vehicle and arm.",
        "As the reference of end-effector tracking.",
        ResolvedMotion,
    ),
    "resolved-pid": _classical(
        "Resolved motion with an integral of the end effector's error.",
        "Against steady disturbances, without an observer.",
        ResolvedMotion,
        settings={"default": Setting("tuned for the smallest error", gains={"integral_gain": 0.5})},
    ),
    "resolved-dob": _classical(
        "Resolved motion with a disturbance observer; the scene's model predicts the state over the sensor delay.",
        "First classical choice for end-effector tracking.",
        ResolvedMotion,
        "quick",
        _observer(1.0, 1.5, 2.2, ("quick",), observer_bandwidth=(4.0, 4.0, 8.0), delay=None),
    ),
    "resolved-adaptive": _classical(
        "Resolved motion for several models of delay and thrust, weighted by the likelihood of their predictions.",
        "Where sensor delay or thrust are unknown.",
        AdaptiveResolvedMotion,
    ),
    "dock-pd": _classical(
        "PD with a limited approach speed.",
        "As the reference of docking.",
        DockPD,
        settings={"default": Setting("gains of the scene")},
    ),
    "ppo": Family(
        "Neural policy, trained from scratch by PPO with an asymmetric critic.",
        "Where only rewards are available: its training needs no gradient.",
        _ALL,
        default="medium",
        settings=_levels(_PRICES, ("medium",)),
    ),
    "shac": Family(
        "Neural policy, trained from scratch by gradients through the simulator (SHAC).",
        "First choice among policies for end effectors; trains in less than a minute.",
        _TOOL,
        default="medium",
        settings={
            **_levels(_PRICES, ("medium",)),
            "long": Setting("from `ppo`, with a memory of 4 s: the smallest error at a limited effort", "frontier"),
            "tool": Setting("for panels: trained in contact, in the storm", "by name"),
            "wide": _WIDE,
        },
    ),
    "shac-distilled": Family(
        "Neural policy that first imitates `dob` and is then improved by SHAC.",
        "First choice among policies for station keeping.",
        _STATION,
        default="quick",
        settings={
            **_levels(_PRICES, ("calm", "quick")),
            "long": Setting("a memory of 7 s: the smallest error at a limited effort", "frontier"),
            "late": Setting("bound: receives the true state as late as the measurements", "late bound"),
            "wide": _WIDE,
        },
    ),
    "residual": Family(
        "Neural correction to the actions of a classical controller, trained by PPO.",
        "Where most of the action should come from a well-understood controller.",
        (*_STATION, *_TRACK),
        default="dob",
        settings={
            base: Setting(f"corrects `{base}` by at most 0.3 of the actuators' limits", base=base)
            for base in ("pd", "dob", "resolved-dob")
        },
    ),
    "blend": Family(
        "Weighted mean of a neural policy and a classical controller, which takes over where the error is large.",
        "Where the smallest error counts, worst episodes too.",
        (*_STATION, *_TOOL),
        default="mpc",
        settings={
            "mpc": Setting(
                "0.55 of `shac-distilled/long` and 0.45 of `mpc`, which takes over between 0.08 and 0.15 m",
                "frontier",
                parts={"shac-distilled/long": 0.55, "mpc": 0.45},
                guard=(0.08, 0.15),
            ),
            "nmpc": Setting(
                "tracking: half of `shac/long` and half of `nmpc`",
                "frontier",
                parts={"shac/long": 0.5, "nmpc": 0.5},
            ),
            "resolved-dob": Setting(
                "panels: 0.3 of `shac/tool` and 0.7 of `resolved-dob`",
                "by name",
                parts={"shac/tool": 0.3, "resolved-dob": 0.7},
            ),
            "universal": Setting(
                "0.3 of `universal` and 0.7 of `mpc`, on any scene", "by name", parts={"universal": 0.3, "mpc": 0.7}
            ),
        },
    ),
    "universal": Family(
        "Neural policy for any vehicle: its weights follow from inertia, damping, thrust, delay and lag.",
        "For a vehicle of your own, without tuning or training.",
        _STATION,
        settings={"default": Setting("trained on drawn vehicles, none of them a shipped scene", "general")},
    ),
}


class ControllerEntry(NamedTuple):
    """Controller of the list: canonical name, family and setting."""

    name: str
    family: Family
    setting: Setting

    @property
    def kind(self) -> type[ClassicalController] | None:
        """Class; None for neural policies and means with them."""
        return self.family.kind

    @property
    def tasks(self) -> tuple[str, ...]:
        """Tasks; of a residual policy the tasks of its base, and of a mean those of all its parts."""
        parts = self.setting.parts or filter(None, [self.setting.base])
        shared = [CONTROLLERS[part].tasks for part in parts] or [self.family.tasks]
        return tuple(task for task in shared[0] if all(task in one for one in shared))

    def make(self, gains: Mapping[str, Any], env: Any = None, **options: Any) -> ClassicalController:
        """Make a classical controller with these gains and the setting's own."""
        assert self.kind is not None
        return self.kind(env, **{**self.setting.gains, **gains, **options})


def _joined(family: str, setting: str) -> str:
    return family if setting == FAMILIES[family].default else f"{family}/{setting}"


#: All controllers by canonical name.
CONTROLLERS = {
    name: ControllerEntry(name, family, setting)
    for key, family in FAMILIES.items()
    for variant, setting in family.settings.items()
    for name in [_joined(key, variant)]
}


def split(name: str) -> tuple[str, str]:
    """Family and setting of a canonical name; of a file the file and "default"."""
    key, _, variant = name.partition("/")
    return (name, "default") if is_file(name) else (key, variant or FAMILIES[key].default)


def names(task: str | None = None, learned: bool | None = None, rivals: bool = False) -> tuple[str, ...]:
    """Names of controllers.

    Parameters
    ----------
    task : str or None
        Task, such as "station-keep"; None: all.
    learned : bool or None
        True: neural policies only; False: classical controllers only.
    rivals : bool
        Without settings along the frontier and bounds.
    """
    return tuple(
        name
        for name, entry in CONTROLLERS.items()
        if (task is None or task in entry.tasks)
        and (learned is None or (entry.kind is None) == learned)
        and (not rivals or entry.setting.role == "rival")
    )


def compared(task: str, frontier: bool) -> tuple[str, ...]:
    """Names of the controllers of a comparison that names none: rivals, or also the frontier and bounds."""
    return tuple(name for name in names(task, rivals=not frontier) if CONTROLLERS[name].setting.role != "by name")


def true_state(name: str) -> str | None:
    """True state that comparisons show a controller: "present", "late" as the measurements, or None: measurements."""
    role = CONTROLLERS[name].setting.role if name in CONTROLLERS else ""
    return {"bound": "present", "late bound": "late"}.get(role)


def is_bound(name: str) -> bool:
    """True for a controller that comparisons show the true state: it bounds the others."""
    return true_state(name) is not None


def is_learned(name: str) -> bool:
    """True for a neural policy, for a controller that one corrects, and for a mean with one."""
    return name.startswith(MLP_PREFIX) or (name in CONTROLLERS and CONTROLLERS[name].kind is None)


def role(name: str) -> str:
    """Role of a controller of the list; see `Setting`."""
    return CONTROLLERS[name].setting.role


def is_file(name: str) -> bool:
    """True for `mlp:FILE` and `py:FILE.py:NAME`."""
    return name.startswith((MLP_PREFIX, CODE_PREFIX))


def canonical(name: str, setting: str | None = None, task: str | None = None) -> str:
    """Canonical name of a controller; names of files are returned as they are.

    Parameters
    ----------
    name : str
        `FAMILY`, `FAMILY/SETTING`, or a file.
    setting : str or None
        Setting; None: the one in the name, or the family's default.
    task : str or None
        Task that the controller must be for.

    Raises
    ------
    ValueError
        An unknown family or setting, or a controller of another task; the message has the close matches.
    """
    if setting is not None and (is_file(name) or "/" in name):
        raise ValueError(f"controller {name!r} allows no further setting, but setting is {setting!r}")
    if name in (MLP_PREFIX, CODE_PREFIX):
        raise ValueError(f"controller {name!r} names no file, but must be mlp:FILE or py:FILE.py:NAME")
    if is_file(name):
        return name
    given = name if setting is None else f"{name}/{setting}"
    key, slash, variant = given.partition("/")
    if (family := FAMILIES.get(key)) is None:
        close = difflib.get_close_matches(given.replace("-", "/"), CONTROLLERS, 3, 0.7)
        close += [one for one in difflib.get_close_matches(given, CONTROLLERS, 3) if one not in close]
        hint = f"close to it: {', '.join(close[:4])}" if close else f"known: {', '.join(_families(task))}"
        raise ValueError(f"unknown controller {given!r}; {hint}; `uvms controllers` lists all")
    if slash and variant not in family.settings:
        close = difflib.get_close_matches(variant, family.settings, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise ValueError(f"{key} has no setting {variant!r}; {hint}its settings: {', '.join(family.settings)}")
    found = _joined(key, variant or family.default)
    if task is not None and task not in CONTROLLERS[found].tasks:
        others = [one for one in names(task) if one.partition("/")[0] == key] or _families(task)
        raise ValueError(f"controller {found!r} is not for {TASKS[task]}; for it: {', '.join(others)}")
    return found


def _families(task: str | None) -> list[str]:
    return list(dict.fromkeys(name.partition("/")[0] for name in names(task)))

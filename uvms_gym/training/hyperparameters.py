"""Hyperparameters in rl_zoo3's format: YAML by environment, and KEY:VALUE."""

import ast
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from uvms_gym._files import read_text

#: Shipped hyperparameters of the algorithm `ppo`; the other algorithms' are beside them.
SHIPPED = Path(__file__).with_name("ppo.yml")
#: Hyperparameters with schedules.
_SCHEDULES = ("learning_rate", "clip_range", "clip_range_vf")
#: Hyperparameters of the run, not of PPO itself.
_OWN = ("n_timesteps", "n_envs", "policy", "env_kwargs", "frame_stack")


def read_hyperparameters(
    env: str, file: Path | None = None, *, variant: str | None = None, algo: str = "ppo"
) -> dict[str, Any]:
    """Read hyperparameters of an environment, by Gymnasium's id, from YAML (None: those shipped for the algorithm).

    With a variant they are updated by the entry `ENV/VARIANT`: "residual" for corrections to a controller, "start" for
    a policy to begin with.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is no YAML by environment, or lacks this one.
    """
    import yaml

    path = file or SHIPPED.with_name(f"{algo}.yml")
    try:
        tables = yaml.safe_load(read_text(path))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from None
    if not isinstance(tables, dict) or not all(isinstance(table, dict) for table in tables.values()):
        raise ValueError(f"{path}: no hyperparameters by environment")
    if env not in tables:
        known = ", ".join(name for name in tables if "/" not in str(name))
        other = "" if file else "; --conf-file names a file with others"
        raise ValueError(f"{path}: no hyperparameters for {env}; known: {known}{other}")
    return {**tables[env], **(tables.get(f"{env}/{variant}", {}) if variant else {})}


def give_way(
    hyperparameters: Mapping[str, Any], arguments: Mapping[str, Any], step: float | None = None
) -> dict[str, Any]:
    """Hyperparameters for an environment with arguments of the user's.

    Step and substeps make the control period together, so either of the user's takes the place of both. `step` is the
    task's default step, s, if the scene states one of its own, which then divides the same control period.
    """
    own = dict(hyperparameters.get("env_kwargs", {}))
    if "dt" in arguments or "substeps" in arguments:
        own = {key: value for key, value in own.items() if key not in ("dt", "substeps")}
    elif step is not None and {"dt", "substeps"} <= own.keys():
        own["substeps"] = max(1, round(own.pop("dt") * own["substeps"] / step))
    return {**hyperparameters, "env_kwargs": own}


def parse_pairs(given: Iterable[str]) -> dict[str, Any]:
    """Read KEY:VALUE; values other than Python literals are strings.

    Raises
    ------
    ValueError
        A pair lacks key or colon, or a key comes twice.
    """
    pairs: dict[str, Any] = {}
    for pair in given:
        key, colon, value = pair.partition(":")
        if not colon or not key:
            raise ValueError(f"{pair!r} is not KEY:VALUE")
        if key in pairs:
            raise ValueError(f"{key} is given twice")
        try:
            pairs[key] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            pairs[key] = value
    return pairs


def count(hyperparameters: Mapping[str, Any], name: str) -> int:
    """`n_timesteps`, `n_envs` or `frame_stack` as a number.

    Raises
    ------
    ValueError
        The number is missing or not a positive whole one.
    """
    value = hyperparameters.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1 <= value < 1e18 or value != int(value):
        raise ValueError(f"{name} is {value!r}, but must be a positive whole number")
    return int(value)


def arguments(hyperparameters: Mapping[str, Any]) -> dict[str, Any]:
    """Convert hyperparameters to arguments of `stable_baselines3.PPO`.

    Raises
    ------
    ValueError
        A schedule or `policy_kwargs` cannot be read.
    """
    given = {key: value for key, value in hyperparameters.items() if key not in _OWN}
    for key in _SCHEDULES:
        if isinstance(given.get(key), str):
            given[key] = _schedule(key, given[key])
    if isinstance(given.get("policy_kwargs"), str):
        given["policy_kwargs"] = _expression(given["policy_kwargs"])
    return given


def _schedule(key: str, text: str) -> Any:
    """A number in linear decrease to 0 ("lin_0.001"), or a constant."""
    from stable_baselines3.common.utils import LinearSchedule

    try:
        if text.startswith("lin_"):
            return LinearSchedule(float(text.removeprefix("lin_")), 0.0, 1.0)
        return float(text)
    except ValueError:
        raise ValueError(f"{key} is {text!r}, but must be a number or a schedule like 'lin_0.001'") from None


def _expression(text: str) -> Any:
    """Expressions of rl_zoo3 without `eval`: literals, `dict(key=...)` and `nn.Tanh`."""
    from torch import nn

    def read(node: ast.expr) -> Any:
        match node:
            case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords):
                return {str(keyword.arg): read(keyword.value) for keyword in keywords}
            case ast.List(elts=items):
                return [read(item) for item in items]
            case ast.Attribute(value=ast.Name(id="nn"), attr=name) if isinstance(getattr(nn, name, None), type):
                return getattr(nn, name)
        return ast.literal_eval(node)

    try:
        return read(ast.parse(text.strip(), mode="eval").body)
    except (ValueError, SyntaxError, TypeError):
        raise ValueError(f"policy_kwargs is {text!r}, but must be like 'dict(net_arch=[64, 64])'") from None

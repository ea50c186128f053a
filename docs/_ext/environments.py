"""Directives `environment`, `options` and `registered`: environments from their docstrings, layouts and options."""

import inspect
import re
from dataclasses import fields
from typing import Any

import gymnasium
from made_markdown import MarkdownDirective, table
from sphinx.application import Sphinx

import uvms_gym
from uvms_gym._core import task_defaults
from uvms_gym.controllers.contract import COMPUTATION
from uvms_gym.envs import Block, TaskEnv, TaskOptions

ACTIONS = ("wrench", "thrusters", "residual")


def environment(name: str, **options: Any) -> TaskEnv:
    """The environment without wrappers."""
    return gymnasium.make(name, **options).unwrapped


def _number(x: float) -> str:
    return f"{x:.4g}".replace("inf", "none")


def _span(values: tuple[float, ...]) -> str:
    minimum, maximum = _number(min(values)), _number(max(values))
    return minimum if minimum == maximum else f"{minimum} to {maximum}"


def _entries(block: Block) -> str:
    return str(block.offset) if block.length == 1 else f"{block.offset}-{block.offset + block.length - 1}"


def action_table(env: TaskEnv) -> str:
    """Entries of an action with their physical range."""
    rows = [
        (
            _entries(b),
            f"`{b.name}`: {b.description}" if b.description else f"`{b.name}`",
            _span(b.low),
            _span(b.high),
            b.unit,
        )
        for b in env.action_layout
    ]
    return table(("Num", "Action", "at -1", "at +1", "Unit"), rows)


def observation_table(env: TaskEnv) -> str:
    """Blocks of an observation with scale and maximum magnitude of an entry."""
    rows = [
        (
            _entries(b),
            f"`{b.name}`: {b.description}",
            _span(b.scale),
            _span(tuple(h / s for h, s in zip(b.high, b.scale))),
            b.unit,
        )
        for b in env.layout
    ]
    return table(("Num", "Observation", "Scale", "Bound", "Unit"), rows)


def size_table(name: str) -> str:
    """Lengths of actions and observations by scene and kind of action."""
    rows = []
    for scene in uvms_gym.scene_names():
        if scene == "free-body":
            continue
        row: list[object] = [f"`{scene}`"]
        for action in ACTIONS:
            try:
                env = environment(name, scene=scene, action=action)
            except ValueError:
                row.append("cannot be actuated")
            else:
                row.append(f"{env.action_space.shape[0]}, {env.observation_space.shape[0]}")
        rows.append(row)
    return table(("Scene", *(f'`action="{action}"`' for action in ACTIONS)), rows)


def documented(kind: type) -> dict[str, tuple[str, str]]:
    """Type and description of the attributes in a numpy-style docstring, by name."""
    text = inspect.cleandoc(kind.__doc__ or "").partition("Attributes\n----------\n")[2]
    found = {}
    for names, type_, body in re.findall(r"(?m)^(\w[\w, ]*) : (.+)\n((?:    .*\n?)+)", text + "\n"):
        for name in names.split(", "):
            found[name] = (type_, " ".join(body.split()))
    return found


def option_rows(kind: type[TaskOptions], *, shared: bool) -> list[tuple[str, str, str]]:
    """Name, default and description of a task's own options, or of those that all tasks have."""
    about = {**documented(TaskOptions), **documented(kind)}
    defaults = task_defaults(kind.task)
    names = {field.name for field in fields(TaskOptions)}
    rows = []
    for field in fields(kind):
        if (field.name in names) is not shared:
            continue
        default = field.default if field.default is not None else defaults.get(field.name)
        rows.append((f"`{field.name}`", f"`{default!r}`", about[field.name][1]))
    return rows


def changed_defaults(kind: type[TaskOptions]) -> str:
    """Sentence on shared options whose defaults differ from those of station keeping."""
    base = TaskOptions.by_task["station-keep"]
    mine, theirs = option_rows(kind, shared=True), option_rows(base, shared=True)
    changed = [f"{mine[i][0]} {mine[i][1]}" for i in range(len(mine)) if mine[i][1] != theirs[i][1]]
    return f" Other defaults here: {'; '.join(changed)}." if changed else ""


class Environment(MarkdownDirective):
    """Page of an environment after Gymnasium's template; the argument is its id."""

    required_arguments = 1

    def markdown(self) -> str:
        """Docstring of the environment, with its tables replaced by those of the layouts."""
        name = self.arguments[0]
        env = environment(name)
        kind = type(env)
        summary, *sections = re.split(r"(?m)^## ", inspect.cleandoc(kind.__doc__ or ""))
        vector = gymnasium.spec(name).vector_entry_point.replace(":", ".")
        spaces = [
            ("Action space", f"`{env.action_space}`"),
            ("Observation space", f"`Box(-bound, bound, {env.observation_space.shape}, float32)`"),
            ("Single", f'`gymnasium.make("{name}")`, {{class}}`{kind.__module__}.{kind.__name__}`'),
            ("Vector", f'`gymnasium.make_vec("{name}", num_envs=N)`, {{class}}`{vector}`'),
        ]
        parts = [
            summary,
            f"![{kind.__name__}: an episode]({self.picture(name)})",
            table(("", "on `petasus-pum`"), spaces),
        ]
        for section in sections:
            title, _, body = section.partition("\n")
            if title in ("Action Space", "Observation Space"):
                made = action_table(env) if title == "Action Space" else observation_table(env)
                body, count = re.subn(r"(?m)(?:^\|.*\n?)+", lambda _, made=made: made + "\n", body)
                if count != 1:
                    raise self.error(f"{kind.__name__}: {count} tables in the section {title}, not 1")
            if title == "Arguments":
                own = option_rows(type(env.options), shared=False)
                body += "\n\nOptions of this task:\n\n" + table(("Option", "Default", "Meaning"), own)
                body += (
                    "\n\nOptions of all tasks: [Environments](index.md)." + changed_defaults(type(env.options)) + "\n"
                )
            if title == "Version History":
                parts.append("## Sizes\n\nLength of an action, and of an observation:\n\n" + size_table(name))
            parts.append(f"## {title}\n{body}")
        return "\n\n".join(parts)

    def picture(self, name: str) -> str:
        """Address of the picture that the extension `pictures` draws."""
        return f"/_generated/{name}.png"


class Options(MarkdownDirective):
    """Options that all tasks have."""

    def markdown(self) -> str:
        """Table with the defaults of station keeping."""
        rows = option_rows(TaskOptions.by_task["station-keep"], shared=True)
        return table(("Option", "Default", "Meaning"), rows)


class Registered(MarkdownDirective):
    """Registered environments."""

    def markdown(self) -> str:
        """Table of ids, control periods and lengths of episodes."""
        rows = []
        for name in sorted(name for name in gymnasium.registry if name.startswith("UVMS-")):
            spec = gymnasium.spec(name)
            env = environment(name)
            period = env.control_period
            steps = spec.max_episode_steps
            given = ", ".join(f"`{key}={value!r}`" for key, value in spec.kwargs.items())
            rows.append((f"`{name}`", f"{period:g} s", f"{steps} ({steps * period:g} s)", given))
        return table(("Environment", "Control period", "Steps", "Arguments"), rows)


class PolicyEntries(MarkdownDirective):
    """Blocks of observations, as a vehicle computes them."""

    def markdown(self) -> str:
        """Table of all blocks of all tasks."""
        return table(("Block", "Computation"), [(f"`{name}`", text) for name, text in COMPUTATION.items()])


def _skip_markdown(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Docstrings of environments are Markdown, and have pages of their own."""
    if inspect.isclass(value) and issubclass(value, TaskEnv) and value is not TaskEnv:
        del lines[1:]
        lines += ["", "Its page under *Environments* describes it in full."]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("environment", Environment)
    app.add_directive("options", Options)
    app.add_directive("registered", Registered)
    app.add_directive("policy-entries", PolicyEntries)
    app.connect("autodoc-process-docstring", _skip_markdown)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

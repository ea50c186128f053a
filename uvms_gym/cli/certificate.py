"""`uvms accuracy --env`: certificate of integration accuracy of environments."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uvms_gym.cli.common import check_known, check_list, fail, line, prepare, progress, read_scene, user_errors
from uvms_gym.cli.output import name_files, say, scientific, table, write_results
from uvms_gym.studies.accuracy import certificate, episodes, plots
from uvms_gym.studies.accuracy.certificate import LIMITS, SHARE, UNITS
from uvms_gym.studies.accuracy.episodes import Case, Configuration, Frame
from uvms_gym.studies.accuracy.work_precision import PRECISIONS, STABILITY_MARGIN, integrators
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.records import circumstances

FILES = ("certificate.json", "certificate.png")
EPISODES = 64
#: Short names of the limited quantities.
HEADER = ("position", "attitude", "joints", "end eff.", "obs.", "reward")


def certify(
    envs: Sequence[str],
    own: dict[str, Any],
    scenes: Sequence[str],
    chosen: dict[str, Sequence[Any]],
    count: int | None,
    seed: int,
    out: Path,
    json_file: Path | None,
) -> None:
    """Certify environments, each in its own scene or in all of `scenes`, and print and store the results.

    `own` are arguments of all environments; `chosen` are given lists of `integrator`, `dtype` and `step`, all empty for
    the candidates of the study; `count` is the number of episodes.
    """
    check_known("integrator", chosen["integrator"], integrators())
    check_known("dtype", chosen["dtype"], PRECISIONS.values())
    count = EPISODES if count is None else count
    cases: dict[str, tuple[Case, list[Configuration]]] = {}
    loaded = {name: read_scene(name) for name in check_list("scene", scenes, [])}
    for env in check_list("env", envs, []):
        for scene in loaded or (None,):
            case = Case(env, own if scene is None else {**own, "scene": loaded[scene]}, count, seed)
            title = env if scene is None else f"{env}, {scene}"
            with user_errors("" if scene is None else f"{title}: "):
                about = episodes.frame(case)
            cases[title] = case, _configurations(title, about, chosen)
    prepare(out, json_file, FILES)
    begun = time.perf_counter()
    results: dict[str, Any] = {}
    with progress():
        for title, (case, configurations) in tracked(cases.items(), "environments"):
            with user_errors(f"{title}: "):
                results[title] = certificate.certify(case, configurations)
        arguments: dict[str, Any] = {"env": list(envs), "env_kwargs": own, "scene": list(scenes), **chosen}
        arguments |= {"episodes": count, "seed": seed}
        spent = time.perf_counter() - begun
        about_run = circumstances("accuracy", arguments) | {"seconds": spent}
        write_results(out, FILES, json_file, {"circumstances": about_run, "results": results})
        with user_errors(verb="write"):
            plots.plot_certificates(out / "certificate.png", results, LIMITS)
    for title, result in results.items():
        _print(title, result, all_steps=not any(chosen.values()))
    _print_notes(results)
    name_files(out, FILES, f" ({spent:.0f} s)")


def _configurations(title: str, about: Frame, chosen: dict[str, Sequence[Any]]) -> list[Configuration]:
    """All combinations of what is given, each with the environment's own values in place of what is not."""
    if not any(chosen.values()):
        return certificate.candidates(about)
    own = about.default
    for step in chosen["step"]:
        if not episodes.divides(step, about.period):
            raise fail(f"{title}: --dt is {step:g}, but must divide the control period of {about.period:g} s")
    return [
        Configuration(integrator, dtype, step)
        for integrator in chosen["integrator"] or [own.integrator]
        for dtype in chosen["dtype"] or [own.dtype]
        for step in chosen["step"] or [own.step]
    ]


def _print(title: str, result: dict[str, Any], all_steps: bool) -> None:
    own = result["default"]
    rows = {Configuration(row["integrator"], row["dtype"], row["step"]): row for row in result["rows"]}
    lines = []
    for configuration, row in rows.items():
        step = f"{configuration.step:g}{'*' if configuration == own else ''}"
        numbers = (f"{scientific(row['judged'][x])}{'!' if x in row['exceeded'] else ''}" for x in LIMITS)
        lines.append((*configuration[:2], step, *numbers, _verdict(row, numbers=False)))
    title_of = f"{title}: errors in {SHARE * 100:g} % of the episodes of the worst drive"
    table(f"{title_of} (!: above the limit; *: the environment's own)", ("", "", "step, s", *HEADER, ""), lines, 2)
    for configuration, row in rows.items():
        if not all_steps or configuration == own:
            _print_drives(title, configuration, result, row)
            line(f"{title}: {configuration.title}: {_verdict(row)}")
    if all_steps:
        for entry in result["recommended"]:
            step = "none of these" if entry["step"] is None else f"{entry['step']:g} s"
            line(f"{title}: recommended step of {entry['integrator']} {entry['dtype']}: {step}")
    line("")


def _verdict(row: dict[str, Any], numbers: bool = True) -> str:
    """Verdict with its reasons; without `numbers` those that no error of the table shows."""
    reasons = [name.replace("_", " ") for name in row["exceeded"] if numbers or name not in LIMITS]
    return ": ".join(filter(None, ("not certified" if row["exceeded"] else "certified", ", ".join(reasons))))


def _print_drives(title: str, configuration: Configuration, result: dict[str, Any], row: dict[str, Any]) -> None:
    lines = []
    for name, errors in row["errors"].items():
        drive = result["drives"][name]
        for quantity, unit in {**UNITS, "return": "1"}.items():
            found = errors[quantity]
            uncertainty = drive["uncertainty"][quantity]["p95"]
            numbers = (scientific(found[key]) for key in ("median", "p95", "worst"))
            label = f"{quantity.replace('_', ' ')}, {unit}"
            lines.append((name if quantity == "position" else "", label, *numbers, scientific(uncertainty)))
    header = ("actions", "error", "median", "95 %", "worst", "reference")
    table(f"{title}: {configuration.title}, over the episodes", header, lines, text_columns=2)


def _print_notes(results: dict[str, Any]) -> None:
    limits = ", ".join(f"{name.replace('_', ' ')} {LIMITS[name]:g} {unit}" for name, unit in UNITS.items())
    any_result = next(iter(results.values()))
    say(
        f"Limits: {limits}. Certified: {SHARE * 100:g} % of the episodes of every drive within all of them, a step at "
        f"minimum {STABILITY_MARGIN:g} times smaller than the maximum stable one, no step warning. Noise: standard "
        f"deviation of the sensor noise, in the worst entry, in {SHARE * 100:g} % of the steps. Spread: standard "
        "deviation of the sum of rewards between episodes; return: its error itself. Reference: "
        f"{any_result['reference'].title} under the same actions; its uncertainty is the difference from "
        f"{any_result['check'].title}."
    )

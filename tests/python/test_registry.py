"""Controllers by name: tuned gains, shipped policies, and what is said where they do not fit."""

import itertools
import json
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import SMALL, layers, observations

import uvms_gym
from uvms_gym import MLP, PD, PID, Residual, ResolvedMotion, _core
from uvms_gym.cli import main
from uvms_gym.cli.common import console
from uvms_gym.controllers import NoControl, registry
from uvms_gym.controllers.base import ClassicalController
from uvms_gym.controllers.families import CONTROLLERS, FAMILIES, TASKS, canonical, is_learned, names, split
from uvms_gym.controllers.registry import Unavailable, available, make_controller, policies, policies_in
from uvms_gym.studies.comparison.catalogue import gain_texts
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.training.evaluation import run_episodes

STORM = "UVMS-StationKeep-Storm-v0"
OPTIONS: dict[str, Any] = {"scene": SMALL, "substeps": 10}
KP = [10.0, 20.0, 30.0, 4.0, 5.0, 6.0]
KD = [11.0, 21.0, 31.0, 5.0, 6.0, 7.0]


def network(seed: int = 0, residual: bool = False, **arguments: Any) -> MLP:
    """A policy for the small scene at a control period of 0.1 s."""
    return MLP(**layers((30 if residual else 24, 8, 6), seed), residual=residual, **OPTIONS, **arguments)


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of policies for the small scene: two seeds of ppo, one of corrections, tuned gains of PD."""
    monkeypatch.setattr(registry, "PRETRAINED", tmp_path)
    monkeypatch.setattr(registry, "FOLDERS", [tmp_path])
    folder = tmp_path / "UVMS-StationKeep" / SMALL / "0.1s"
    folder.mkdir(parents=True)
    for seed in (0, 3):
        network(seed).save(folder / f"ppo-{seed}.safetensors")
    # It was trained on the PD with other gains than those tuned since.
    notes = {"base": "pd", "base_gains": json.dumps({"kp": KD, "kd": KD}), "limit": "0.2"}
    network(5, residual=True, notes=notes).save(folder / "residual-pd-1.safetensors")
    tuned = {"pd": {"gains": {"kp": KP, "kd": KD}, "tuning": {"episodes": 4096}}}
    (folder / "gains.json").write_text(json.dumps(tuned))
    return folder


def message(name: str, error: type[Exception] = ValueError, **options: Any) -> str:
    with pytest.raises(error) as caught:
        make_controller(name, **(OPTIONS | options))
    (line,) = str(caught.value).splitlines()
    return line


def test_classical_controllers_have_the_tuned_gains_or_their_own(shipped: Path) -> None:
    tuned = make_controller("pd", **OPTIONS)
    assert isinstance(tuned, PD)
    np.testing.assert_array_equal(tuned.kp, KP)
    np.testing.assert_array_equal(tuned.kd, KD)
    own = PD(scene=SMALL)
    for other in (make_controller("pd", gains="scene", **OPTIONS), make_controller("pd", scene=SMALL)):
        np.testing.assert_array_equal(other.kp, own.kp)
    assert isinstance(make_controller("pid", **OPTIONS), PID)
    assert isinstance(make_controller("none", **OPTIONS), NoControl)
    assert isinstance(make_controller("resolved", task="ee-track"), ResolvedMotion)
    with pytest.raises(ValueError, match="gains is 'mine', but must be 'tuned' or 'scene'"):
        make_controller("pd", gains="mine", **OPTIONS)  # type: ignore[arg-type]


def test_learned_controllers_are_the_shipped_policies(shipped: Path) -> None:
    env = gymnasium.make(STORM, scene=SMALL)
    rows = observations(20)
    assert {name: list(files) for name, files in policies(env).items()} == {"ppo": [0, 3], "residual/pd": [1]}
    for seed in (0, 3):
        np.testing.assert_array_equal(
            make_controller("ppo", env, seed=seed).predict(rows)[0], network(seed).predict(rows)[0]
        )
    corrected = make_controller("residual", "pd", env, seed=1)
    expected = Residual(PD(env, kp=KD, kd=KD), network(5, residual=True), 0.2)
    np.testing.assert_array_equal(corrected.predict(rows)[0], expected.predict(rows)[0])
    file = shipped / "ppo-3.safetensors"
    np.testing.assert_array_equal(make_controller(f"mlp:{file}", env).predict(rows)[0], network(3).predict(rows)[0])


def test_what_is_available_is_what_there_is_all_for(shipped: Path) -> None:
    classical = [*names("station-keep", learned=False)]
    assert list(available(**OPTIONS)) == [*classical, "ppo", "residual/pd"]
    assert list(available(scene=SMALL)) == classical
    assert list(available(**OPTIONS, action="thrusters")) == classical
    assert set(names()) > set(names("ee-track")) > {"none", "resolved", "ppo"}
    # A mean is for the tasks of all its parts.
    assert CONTROLLERS["blend"].tasks == ("station-keep",) and CONTROLLERS["blend/nmpc"].tasks == ("ee-track",)


def test_a_controller_is_a_family_and_a_setting() -> None:
    for name, entry in CONTROLLERS.items():
        family, setting = split(name)
        assert FAMILIES[family] is entry.family and FAMILIES[family].settings[setting] is entry.setting
        assert canonical(family, setting) == canonical(f"{family}/{setting}") == canonical(name) == name
        assert entry.tasks and is_learned(name) == (entry.kind is None)
    # No two have files of one name.
    assert len({name.replace("/", "-") for name in CONTROLLERS}) == len(CONTROLLERS)
    assert canonical("mlp:a/b.safetensors") == "mlp:a/b.safetensors"
    env: Any = gymnasium.make(STORM)
    alike = {repr(make_controller(*given)) for given in (("dob", "calm", env), ("dob/calm", env))}
    alike |= {repr(make_controller("dob/calm", env=env))}
    alike |= {repr(make_controller("dob", setting="calm", **env.unwrapped.options.to_dict()))}
    assert len(alike) == 1 and repr(make_controller("dob", env)) not in alike


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("dob/clam", "dob has no setting 'clam'; did you mean calm? its settings: plain, still, calm, medium, quick"),
        ("pd/x", "pd has no setting 'x'; its settings: default"),
        ("dob/", "dob has no setting ''; its settings: plain, still"),
        ("py:own.py:Own", "'py:own.py:Own' names Python code, which only commands and comparisons run"),
        ("dob-calm", "unknown controller 'dob-calm'; close to it: dob/calm, "),
        ("mcp", "unknown controller 'mcp'; close to it: mpc"),
        ("magic", "unknown controller 'magic'; known: none, pd"),
        ("residual/resolved-dob", "controller 'residual/resolved-dob' is not for UVMS-StationKeep; for it: residual/p"),
    ],
)
def test_errors_of_unknown_names_list_close_ones_of_the_task(name: str, line: str) -> None:
    text = message(name)
    assert text.startswith(line)
    # That one is for another task.
    assert "resolved" not in text or "resolved" in name


def test_errors_of_another_task_list_its_controllers() -> None:
    assert "controller 'pd' is not for UVMS-EETrack; for it: none, nmpc, resolved" in message("pd", task="ee-track")


@pytest.mark.parametrize("name", ["dob/calm", "mlp:policy.safetensors"])
def test_a_name_that_is_complete_allows_no_further_setting(name: str) -> None:
    with pytest.raises(ValueError, match=f"controller '{name}' allows no further setting, but setting is 'calm'"):
        make_controller(name, "calm", **OPTIONS)
    with pytest.raises(TypeError, match="name must be a string, not int"):
        make_controller(5)  # type: ignore[arg-type]


def test_a_folder_of_policies_is_searched_for_a_while(shipped: Path, tmp_path: Path, capsys: Any) -> None:
    more = tmp_path / "more" / shipped.relative_to(tmp_path)
    more.mkdir(parents=True)
    network(8).save(more / "ppo-8.safetensors")
    with policies_in(tmp_path / "more"):
        assert list(policies(**OPTIONS)["ppo"]) == [0, 3, 8]
    given = ["compare", "--scene", SMALL, "--controller", "ppo", "--episodes", "2", "--out", str(tmp_path / "out")]
    for arguments, found in (([], [0, 3]), (["--policies", str(tmp_path / "more")], [0, 3, 8]), ([], [0, 3])):
        assert main([*given, *arguments]) == 0
        (result,) = json.loads((tmp_path / "out" / "compare.json").read_text())["results"]
        assert result["controllers"]["ppo"]["training_seeds"] == found
    assert main([*given, "--policies", str(tmp_path / "out")]) == 2
    assert "out has no policies TASK/SCENE/PERIODs/NAME-SEED.safetensors" in capsys.readouterr().err


def test_errors_of_missing_policies_list_the_shipped_ones(shipped: Path) -> None:
    where = f"UVMS-StationKeep, scene {SMALL}, control period 0.1 s, actions wrench"
    line = message("residual", Unavailable)
    assert line.startswith(f"no policy residual is there for {where}; for it: ppo, residual/pd")
    line = message("ppo", Unavailable, seed=1)
    assert line == f"no policy ppo of training seed 1 is there for {where}; its seeds: 0, 3"
    line = message("ppo", Unavailable, substeps=5)
    assert "control period 0.05 s" in line and f"policies are for UVMS-StationKeep {SMALL} 0.1s" in line
    assert "scene petasus-pum" in message("ppo", Unavailable, scene="petasus-pum")
    assert "UVMS-EETrack" in message("ppo", Unavailable, task="ee-track")
    assert "actions thrusters" in message("ppo", Unavailable, action="thrusters")


def test_a_shipped_policy_for_something_else_is_refused_with_its_file(shipped: Path) -> None:
    network(residual=True).save(shipped / "ppo-0.safetensors")
    line = message("ppo")
    assert line.startswith(f"{shipped / 'ppo-0.safetensors'}: ") and "this is a residual policy; load it with" in line


def test_corrections_to_something_else_are_refused(shipped: Path) -> None:
    file = shipped / "residual-pd-1.safetensors"
    network(residual=True, notes={"base": "pid"}).save(file)
    assert message("residual/pd", seed=1) == f"{file}: its base is pid, but must be pd"
    network(residual=True, notes={"limit": "7"}).save(file)
    assert message("residual/pd", seed=1) == f"{file}: limit is 7, but must be in [0, 1]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "no JSON: Expecting property name"),
        ("[1]", "holds no dict of controllers"),
        ('{"pd": 3}', "pd has no dict of gains"),
        ('{"pd": {"gains": {"kp": [1, 2]}}}', "pd: gain kp is [1.0,2.0], but must be 6 numbers"),
        ('{"pd": {"gains": {"kq": [1]}}}', "pd: unknown gain 'kq'"),
        ('{"pd": {"gains": {"kp": [1, 1, 1, 1, 1, -1]}}}', "pd: "),
    ],
)
def test_broken_gains_are_named_with_their_file(shipped: Path, text: str, words: str) -> None:
    file = shipped / "gains.json"
    file.write_text(text)
    assert message("pd").startswith(f"{file}: {words}")


@pytest.mark.parametrize(
    ("name", "delay", "warning"),
    [
        ("pd", 0, None),
        ("pd", 1, None),
        ("pd", 2, "default gains take the place of tuned ones"),
        ("resolved-pid", 3, "default gains take the place of tuned ones"),
        # They predict over it.
        ("resolved-dob", 0, None),
        ("resolved-dob", 3, None),
        ("dob/calm", 3, None),
        ("mpc", 2, None),
        ("nmpc", 2, None),
        # 1 period by the mean of those drawn.
        ("dob/calm", (0, 3), "it may be unstable"),
        ("ppo", 0, "it may be unstable"),
        ("shac-distilled/wide", 3, None),
        ("shac/wide", 3, None),
    ],
)
def test_a_delay_that_a_controller_was_not_tuned_for_is_warned_of(name: str, delay: Any, warning: str | None) -> None:
    env = STORM if name in names("station-keep") else "UVMS-EETrack-Storm-v0"
    given = {"time": [0.1 * n for n in delay], "periods": 0} if isinstance(delay, tuple) else {"periods": delay}
    envs = gymnasium.make_vec(env, num_envs=2, disturbance={"base": "storm", "delay": given})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = make_controller(name, envs)
    said = [str(w.message) for w in caught if issubclass(w.category, uvms_gym.ControllerWarning)]
    assert len(said) == (warning is not None)
    found = " to ".join(map(str, np.atleast_1d(delay)))
    assert not said or f"delay is {found} instead of 1 control periods: {warning}" in said[0]
    if isinstance(made, ClassicalController):
        shipped = registry.tuned(name, envs)
        assert shipped is not None
        tuned = all(np.array_equal(made.gains[key], value) for key, value in shipped["gains"].items())
        assert tuned == ("default" not in str(warning))


@pytest.mark.parametrize("task", ["station-keep", "ee-track"])
def test_classical_controllers_are_no_worse_tuned_than_untuned_at_any_delay(task: str) -> None:
    env = f"{TASKS[task]}-Storm-v0"
    dt = {"station-keep": 0.025, "ee-track": 0.01}[task]
    for level, delay in itertools.product(("calm", "storm"), (0, 2, 3)):
        disturbance = {"base": level, "delay": {"periods": delay}}
        envs = gymnasium.make_vec(env, num_envs=16, disturbance=disturbance, dt=dt, substeps=round(0.1 / dt))
        for name in names(task, learned=False, rivals=True)[1:]:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                pair = [make_controller(name, envs, gains=gains) for gains in ("tuned", "scene")]
                errors = [float(np.median(pose_rms(run_episodes(envs, c, 5_000_000, 100), task))) for c in pair]
            # In calm water both are within millimetres.
            assert errors[0] <= 1.05 * errors[1] + 0.005, (name, level, delay, errors)


def test_gains_are_only_for_their_scene_task_and_period(shipped: Path) -> None:
    assert registry.tuned("pd", **OPTIONS) == {"gains": {"kp": KP, "kd": KD}, "tuning": {"episodes": 4096}}
    assert registry.tuned("pd/default", **OPTIONS) == registry.tuned("pd", **OPTIONS)
    assert registry.tuned("pid", **OPTIONS) is None
    assert registry.tuned("pd", scene=SMALL) is None
    # Conditions other than those change nothing.
    env = gymnasium.make(STORM, scene=SMALL, disturbance="calm", thruster_lag=0.3)
    np.testing.assert_array_equal(make_controller("pd", env).kp, KP)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", names(learned=False))
def test_every_classical_controller_is_made_for_its_tasks(name: str) -> None:
    for task in CONTROLLERS[name].tasks:
        made = make_controller(name, task=task, scene="bluerov2-heavy-alpha5", substeps=10)
        env = gymnasium.make(f"{TASKS[task]}-Storm-v0", scene="bluerov2-heavy-alpha5")
        observation, _ = env.reset(seed=0)
        action, _ = made.predict(observation)
        assert action.shape == env.action_space.shape


def test_the_command_lists_families_settings_gains_and_results(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "width", 300)

    def shown(*arguments: str) -> str:
        assert main(["controllers", *arguments]) == 0
        return " ".join(capsys.readouterr().out.split())

    text = shown()
    assert all(family in text for family in FAMILIES) and "quick (default)" in text and "Gains" not in text
    text = shown("dob/calm")
    tuned = make_controller("dob/calm", gymnasium.make(STORM))
    assert f"dob/calm: kp={np.asarray(tuned.kp).tolist()}" in text  # type: ignore[attr-defined]
    assert "effort 1.1, variation 1.2" in text and "storm, delay 1" in text and "25.77 [25.36, 26.23]" in text
    assert "dob/still" not in text and "dob/still" in shown("dob")
    text = shown("--env", STORM)
    assert "shac-distilled/wide" in text and "storm-wide, delay 0 to 3" in text and "resolved" not in text
    assert "Nothing is tuned or trained for scene petasus" in shown("--scene", "petasus")
    for arguments, words in (
        (["dob/clam"], "did you mean calm?"),
        (["--env", "CartPole-v1"], "CartPole-v1' is no env"),
    ):
        assert main(["controllers", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line


@pytest.mark.parametrize("kind", dict.fromkeys(entry.kind for entry in CONTROLLERS.values() if entry.kind))
def test_every_gain_has_a_meaning_of_its_own(kind: Any) -> None:
    texts = gain_texts(kind)
    assert list(texts) == _core.gain_names(kind.kind)
    for name, text in texts.items():
        assert len(text) > 20 and "Meaning as in" not in text and text.count("by default") <= 1, (name, text)

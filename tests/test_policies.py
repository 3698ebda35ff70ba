"""Policies from anywhere: shipped ones in Gymnasium, foreign ones in evaluation, and those that do not work."""

import copy
import random
import signal
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch

import mimicbench
from mimicbench.commands.telling import tell_rates
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.failures import failure
from mimicbench.evaluate.rollout import Judged, Protocol, policy_rows, run_policy
from mimicbench.evaluate.rows import summarize
from mimicbench.objects.registry import make_object
from mimicbench.policies.loading import load_policy
from mimicbench.policies.registry import LOADERS
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.registry import TASKS
from stool import H1, standing

SIT_CHAIR = TASKS.get("sit-chair")
POS, JOINTS = standing()
SHIPPED = Path(mimicbench.__path__[0]) / "checkpoints" / "sit-chair"


def starts(count):
    """Clips that begin at rest around chairs; what comes after their first frames is nobody's business."""
    clips = []
    for i in range(count):
        bearing, obj = 2.0 * i, make_object(f"chair-0-{i:05d}")
        pos = np.array([1.5 * np.cos(bearing), 1.5 * np.sin(bearing), POS[2]])
        clips.append(
            RobotMotion(
                f"start-{i}",
                "sit-chair",
                "h1",
                H1.joint_names,
                50.0,
                np.tile(pos, (5, 1)),
                np.tile(rot.from_yaw(np.array(bearing + np.pi + 0.3 * i)), (5, 1)),
                np.tile(JOINTS, (5, 1)),
                obj.id,
                f"start-{i}",
            )
        )
    return clips


def clip_set(count, seconds):
    motions = starts(count)
    objects = {motion.object_id: make_object(motion.object_id) for motion in motions}
    return ClipSet(replace(SIT_CHAIR, time_limit=seconds), H1, motions, objects)


def in_gymnasium(policy, clips):
    """Run a policy in a vector environment from the first frames of clips; the arrays are all that it gets."""
    envs = gymnasium.make_vec(
        "mimicbench/SitChair-v0",
        num_envs=len(clips),
        split="all",
        starts=clips.motions,
        observe=policy.observations,
        gains=policy.gains,
        time_limit=clips.task.time_limit,
        terminate_on_success=False,
        autoreset_mode="Disabled",
        workers=1,
    )
    seen, _ = envs.reset(seed=0, options={"start": np.arange(len(clips))})
    policy.reset(torch.arange(len(clips)), Observations.from_arrays(seen))
    ended = np.zeros(len(clips), bool)
    while not ended.any():
        target = policy.act(Observations.from_arrays(seen))
        seen, _, terminated, truncated, info = envs.step(target.numpy())
        ended = terminated | truncated
    return envs, info


@pytest.mark.parametrize(("name", "seconds"), [("online", 2.4), ("planner", 2.4), ("bc-clock", 1.2)])
def test_a_shipped_policy_in_gymnasium_gives_the_episodes_of_evaluation(name, seconds):

    torch.set_num_threads(1)
    clips = clip_set(3, seconds)
    first, second = (load_policy(SHIPPED / name, H1, SIT_CHAIR) for _ in range(2))
    told = []
    run = run_policy(first, clips, record=[0, 1, 2], tick=told.append, env_config=EnvConfig(workers=1))[0]
    assert told == [1] * int(seconds), "a second of robots side by side after the other"
    envs, info = in_gymnasium(second, clips)
    found = envs.unwrapped.episodes.metrics.verdict()
    for key, value in vars(run.verdict).items():
        torch.testing.assert_close(getattr(found, key), value, rtol=0, atol=0, equal_nan=True)
    last = np.stack([run.recordings[i][-1] for i in range(3)])
    assert envs.unwrapped.episodes.qpos().astype(np.float32).tobytes() == last.tobytes(), "as it was recorded"
    assert run.verdict.steps.tolist() == [round(seconds * 50)] * 3 and not run.errors
    np.testing.assert_array_equal(info["effort"], run.verdict.effort)


POLICY = """
    import torch

    class Still:
        observations = ("proprio",)
        gains = "improved"

        def to(self, device):
            self.device = device

        def reset(self, ids, obs):
            self.steps = 0

        def act(self, obs):
            self.steps += 1
            target = torch.zeros(obs.num_envs, 19, device=self.device)
            BODY
            return target

    def make_policy():
        return Still()
"""


def written(path, body="pass", text=POLICY):
    path.write_text(textwrap.dedent(text).replace("BODY", body))
    return path


def judged(path, seconds=0.2):
    clips = clip_set(3, seconds)
    runs = run_policy(load_policy(path, H1, SIT_CHAIR), clips, env_config=EnvConfig(workers=1))
    return policy_rows(runs, clips, Judged("imitate", path.stem, "improved", 0))


def test_a_policy_of_a_python_file_is_judged(tmp_path):
    rows = judged(written(tmp_path / "still.py"))
    assert [(row.policy, row.steps, row.error) for row in rows] == [("still", 10, "")] * 3


def test_a_policy_of_another_task_says_where_it_belongs():
    lying = Path(mimicbench.__path__[0]) / "checkpoints" / "lie-bed" / "planner-no-clock"
    with pytest.raises(BadFile, match="was learned at lie-bed, and does not fit sit-chair; judge it there"):
        load_policy(lying, H1, SIT_CHAIR)


def test_targets_may_be_more_precise_than_what_is_observed(tmp_path):
    body = "assert {term.dtype for term in obs.values()} == {torch.float32}; target = target.double()"
    rows = judged(written(tmp_path / "still.py", body))
    assert [(row.steps, row.error) for row in rows] == [(10, "")] * 3


@pytest.mark.parametrize(
    ("body", "told", "failed", "steps"),
    [
        ('assert self.steps < 4, "tired"', "act raised AssertionError: tired (odd.py, line 17)", [0, 1, 2], [3, 3, 3]),
        ("target = target[:, :7]", "act gave a tensor of (3, 7) instead of a tensor of (3, 19)", [0, 1, 2], [0, 0, 0]),
        ("return target.long()", "act gave torch.int64 on cpu instead of numbers on cpu", [0, 1, 2], [0, 0, 0]),
        ("return target.numpy()", "act gave ndarray instead of a tensor of (3, 19)", [0, 1, 2], [0, 0, 0]),
        ("target[1, 4] = float('nan') if self.steps == 6 else 0.0", "not finite", [1], [10, 5, 10]),
        ("target[:] = float('inf')", "not finite", [0, 1, 2], [0, 0, 0]),
        ("target[2, 4] = -1e30 if self.steps == 6 else 0.0", "act gave targets beyond 1e+10 rad", [2], [10, 10, 5]),
        ("if self.steps == 3: import sys; sys.exit('enough')", "act raised SystemExit: enough", [0, 1, 2], [2, 2, 2]),
    ],
)
def test_a_policy_that_does_not_work_fails_its_episodes_alone(body, told, failed, steps, tmp_path):
    sound, rows = judged(written(tmp_path / "still.py")), judged(written(tmp_path / "odd.py", body))
    assert [row.episode for row in rows if row.error] == failed
    assert all(told in rows[i].error and not (rows[i].success or rows[i].stays) for i in failed)
    assert [row.steps for row in rows] == steps
    for i in {0, 1, 2} - set(failed):
        assert replace(rows[i], policy="still") == sound[i], "the others are as they would be without it"


@pytest.mark.parametrize("body", ["while {}: pass", "if {}: import time; time.sleep(60)"])
def test_a_policy_that_takes_too_long_is_stopped(body, tmp_path):
    """In the batch in which it does; those before it count."""
    body = body.format("self.steps == 3 and obs.num_envs == 1")
    slow = load_policy(written(tmp_path / "slow.py", body), H1, SIT_CHAIR)
    clips = clip_set(3, 0.2)
    runs = run_policy(slow, clips, Protocol(batch=2, patience=0.5), env_config=EnvConfig(workers=1))
    rows = policy_rows(runs, clips, Judged("imitate", "slow", "improved", 0))
    assert [row.error for row in rows] == ["", "", "act took more than 0.5 s"]
    assert [row.steps for row in rows] == [10, 10, 2] and not rows[2].success
    assert summarize(rows).to_dict()["errors"] == {"act took more than 0.5 s": [2]}
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


def test_a_policy_may_plan_before_its_episodes(tmp_path):
    program = POLICY.replace("self.steps = 0", "self.steps = 0; import time; time.sleep(0.7)")
    slow = load_policy(written(tmp_path / "slow.py", text=program), H1, SIT_CHAIR)
    for patience, told in ((0.5, {}), (0.05, {0: "reset took more than 0.5 s"})):
        (run,) = run_policy(slow, clip_set(1, 0.2), Protocol(patience=patience), env_config=EnvConfig(workers=1))
        assert run.errors == told


def test_a_policy_may_go_elsewhere_and_rows_do_not(tmp_path, monkeypatch):
    """Relative paths of whoever judges it mean the same as before, whenever it goes."""
    (tmp_path / "other").mkdir()
    program = "import os\nos.chdir('other')\n" + textwrap.dedent(POLICY)
    written(tmp_path / "odd.py", "import os; os.chdir('/')", program)
    monkeypatch.chdir(tmp_path)
    assert [(row.steps, row.error) for row in judged(Path("odd.py"))] == [(10, "")] * 3
    assert Path.cwd() == tmp_path


def test_random_numbers_are_a_policys_own_and_the_same_in_every_run(tmp_path):
    """As they are made, and as it acts; nobody else's are moved on, nor is the default precision changed."""
    text = """
    import random
    import numpy as np
    import torch
    torch.set_default_dtype(torch.float64)
    FIRST = torch.rand(1)
    """
    body = "target += FIRST + 0.1 * (torch.randn_like(target) + np.random.rand() + random.random())"
    path = written(tmp_path / "noisy.py", body, text + POLICY)
    torch.manual_seed(3), np.random.seed(3), random.seed(3)
    alone = torch.rand(2), np.random.rand(2), random.random()
    torch.manual_seed(3), np.random.seed(3), random.seed(3)
    first, second = judged(path), judged(path)
    assert first == second and not any(row.error for row in first)
    assert len({row.max_energy for row in first}) == 3
    after = torch.rand(2), np.random.rand(2), random.random()
    assert all(np.array_equal(one, other) for one, other in zip(alone, after, strict=True))
    assert torch.get_default_dtype() == torch.float32


def test_what_a_policy_prints_is_not_taken_for_results(tmp_path, capsys):
    text = "print('loading')\n" + textwrap.dedent(POLICY)
    assert not any(row.error for row in judged(written(tmp_path / "talks.py", "print('acting')", text)))
    told = capsys.readouterr()
    assert told.out == "" and "loading" in told.err and "acting" in told.err


def test_whatever_a_policy_raises_is_its_own_failure(tmp_path):
    body = "import asyncio; raise asyncio.CancelledError('gone')"
    assert {row.error for row in judged(written(tmp_path / "odd.py", body))} == {
        "act raised CancelledError: gone (odd.py, line 17)"
    }
    odd = written(tmp_path / "lacks.py", "obs['contacts']")
    assert {row.error.partition("(")[2] for row in judged(odd)} == {"lacks.py, line 17)"}, "ours, by its mistake"
    with pytest.raises(MimicbenchError, match="makes no policy: CancelledError"):
        judged(written(tmp_path / "none.py", text="import asyncio\nraise asyncio.CancelledError('gone')"))
    listed = textwrap.dedent(POLICY).replace('("proprio",)', '(["proprio"],)')
    with pytest.raises(MimicbenchError, match=r"observes \['proprio'\], which is no name; give a tuple of names"):
        judged(written(tmp_path / "listed.py", text=listed))


def test_errors_are_listed(tmp_path, capsys):
    rows = judged(written(tmp_path / "odd.py", "target[1:, 4] = float('nan') if self.steps == 6 else 0.0"))
    tell_rates([rows], as_json=False)
    assert "odd failed 2 of 3 episodes: act gave targets that are not finite (in 1, 2)" in capsys.readouterr().out
    assert [failure(row) for row in rows][1:] == ["stopped by an error"] * 2


def test_a_failed_episode_is_no_success(tmp_path):
    """Even if K was fulfilled before."""
    from mimicbench.evaluate.rollout import _failed

    run = run_policy(
        load_policy(written(tmp_path / "still.py"), H1, SIT_CHAIR), clip_set(2, 0.1), env_config=EnvConfig(workers=1)
    )[0]
    done = replace(run.verdict, success=torch.tensor([True, True]), stays=torch.tensor([True, True]))
    found = _failed(done, {1: "act raised ValueError"})
    assert found.success.tolist() == found.stays.tolist() == [True, False]


def test_each_policy_has_its_own_neighbors(tmp_path):
    """Whichever was loaded first, and whenever it imports them: policies may each have a `helper` in their folder."""
    program = POLICY.replace("import torch", "import helper\n    import torch").replace("return Still()", "LATE")
    late = """
        import also
        assert also.WHO == helper.WHO
        return Still()"""
    act = "import package.inner; assert package.inner.WHO == helper.WHO == WHO == getattr(helper, 'said', WHO)"
    policies, before = [], (set(sys.modules), list(sys.path))
    for name in ("first", "second"):
        (tmp_path / name / "package").mkdir(parents=True)
        for neighbor in ("helper.py", "also.py", "package/inner.py"):
            (tmp_path / name / neighbor).write_text(f"WHO = {name!r}")
        text = program.replace("LATE", late).replace("class Still", f"WHO = {name!r}\n\n    class Still")
        policies.append(load_policy(written(tmp_path / name / "mine.py", act, text), H1, SIT_CHAIR))
    clips = clip_set(1, 0.1)
    for policy in (*policies, copy.deepcopy(policies[0])):
        assert not run_policy(policy, clips, env_config=EnvConfig(workers=1))[0].errors
    broken = written(tmp_path / "first" / "broken.py", text="import helper\n1 / 0")
    with pytest.raises(MimicbenchError, match="ZeroDivisionError"):
        load_policy(broken, H1, SIT_CHAIR)
    assert not {"helper", "also", "package", "_policy_mine", "_policy_broken"} & (set(sys.modules) - before[0])
    assert sys.path == before[1]


def test_a_policy_may_run_another_ones_file(tmp_path):
    """Which finds its own neighbors, and so does the first one after it."""
    outer = """
    def make_policy():
        import helper
        from pathlib import Path
        from mimicbench.policies.loading import load_policy
        from mimicbench.robots.registry import ROBOTS
        from mimicbench.tasks.registry import TASKS

        path = Path(__file__).parent / "inner" / "mine.py"
        policy = load_policy(path, ROBOTS.get("h1"), TASKS.get("sit-chair"))
        import helper as again
        assert again is helper and helper.WHO == "outer"
        return policy
    """
    (tmp_path / "inner").mkdir()
    (tmp_path / "helper.py").write_text("WHO = 'outer'")
    (tmp_path / "inner" / "helper.py").write_text("WHO = 'inner'")
    written(tmp_path / "inner" / "mine.py", "import helper; assert helper.WHO == 'inner'")
    assert [row.error for row in judged(written(tmp_path / "mine.py", text=outer))] == [""] * 3


def test_files_that_make_no_policy(tmp_path):
    def told(text, name="odd.py"):
        with pytest.raises(MimicbenchError) as caught:
            load_policy(written(tmp_path / name, text=text), H1, SIT_CHAIR)
        return str(caught.value)

    with pytest.raises(BadFile, match="does not exist"):
        load_policy(tmp_path / "none.py", H1, SIT_CHAIR)
    assert "make_policy()" in told("x = 1")
    assert "SyntaxError" in told("def make_policy(:")
    assert "(odd.py, line 2)" in told("import torch\ntorch.zeros(-1)"), "not the line in the library"
    assert "ZeroDivisionError" in told("def make_policy():\n    return 1 / 0")
    assert "SystemExit" in told("import sys\n\nsys.exit(0)"), "it does not end the command as if all were done"
    assert "SystemExit" in told("def make_policy():\n    raise SystemExit")
    assert "without observations and gains" in told("def make_policy():\n    return 1")
    assert "give a tuple" in told(POLICY.replace('("proprio",)', '"proprio"'))
    assert "is a NoneType; give a tuple" in told(POLICY.replace('("proprio",)', "None"))
    assert "are a list; give their name" in told(POLICY.replace('"improved"', '["improved"]'))
    assert "no robot can sense" in told(POLICY.replace("proprio", "root_pose"))
    assert "smell" in told(POLICY.replace("proprio", "smell"))
    assert "unknown gains 'none'" in told(POLICY.replace("improved", "none"))


def test_kinds_of_checkpoints_are_a_registry(tmp_path):
    assert LOADERS.names() == ("act", "bc", "diffusion", "hit", "online", "planner", "ppo")
    for kind in LOADERS:
        assert LOADERS.get(kind).name == kind
    with pytest.raises(BadFile, match="'tracker', which is no policy; give the folder of one of these kinds: act"):
        load_policy(SHIPPED / "tracker", H1, SIT_CHAIR)
    with pytest.raises(BadFile):
        load_policy(tmp_path, H1, SIT_CHAIR)

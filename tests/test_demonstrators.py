"""Demonstrations by a policy, which needs no clips: from starts drawn by rule to a clone."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.benchmark import keys, run_stage
from mimicbench.benchmark.graph import demonstrated, start
from mimicbench.benchmark.recipe import Recipe, stage_type
from mimicbench.benchmark.shipped import shipped_trackers
from mimicbench.benchmark.verifying import verify_demos
from mimicbench.core.run import RunContext
from mimicbench.core.settings import BadSetting
from mimicbench.envs.rule_starts import standing
from mimicbench.imitate.learned import load_learner
from mimicbench.imitate.learners.bc import BCConfig
from mimicbench.imitate.learners.hit import HITConfig, HITImitation
from mimicbench.imitate.lerobot import DATASET, load_demos
from mimicbench.imitate.settings.cloning import DaggerConfig, TrainConfig
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.objects.make import ObjectsConfig
from mimicbench.track.settings import DrivenConfig
from stool import H1
from test_imitate import TINY
from tracked import SIT_CHAIR, clip_set

CONTEXT = RunContext(workers=1, quiet=True)


def test_who_stands_is_where_the_rule_says():
    objects = clip_set().objects
    few, more = (standing(SIT_CHAIR, H1, objects, count, 0) for count in (2, 4))
    assert [motion.id for motion in few.motions] == ["start-0-000000", "start-0-000001"]
    for one, other in zip(few.motions, more.motions, strict=False):
        np.testing.assert_array_equal(one.root_pos_w, other.root_pos_w)
    assert {motion.frames for motion in more.motions} == {600} and len(more) == 4
    places = np.array([motion.root_pos_w[0, :2] for motion in more.motions])
    assert (np.linalg.norm(places, axis=1) > 0.9).all() and len(np.unique(places, axis=0)) == 4
    assert (more.motions[0].root_pos_w == more.motions[0].root_pos_w[0]).all(), "it stands"


def test_who_stands_may_stand_as_people_do():
    objects, pose = clip_set().objects, np.array(H1.rest_pose)
    straight = 0.5 * pose
    (motion,) = standing(SIT_CHAIR, H1, objects, 1, 0, [straight]).motions
    np.testing.assert_array_equal(motion.joint_pos[0], straight)
    (at_rest,) = standing(SIT_CHAIR, H1, objects, 1, 0, [pose]).motions
    assert motion.root_pos_w[0, 2] > at_rest.root_pos_w[0, 2] + 0.01, "its soles are on the floor"
    np.testing.assert_array_equal(motion.root_pos_w[0, :2], at_rest.root_pos_w[0, :2])
    drawn = standing(SIT_CHAIR, H1, objects, 20, 0, [straight, pose]).motions
    assert {float(one.joint_pos[0, 3]) for one in drawn} == {straight[3], pose[3]}


def test_where_demonstrations_start():
    with pytest.raises(BadSetting, match=r"demos\.starts is 'anywhere'; give clips, rule or poses"):
        DemosConfig(starts="anywhere", expert="planner")
    with pytest.raises(BadSetting, match="no clip for a tracker; name a policy"):
        DemosConfig(starts="rule")


def test_a_clone_of_a_planner_without_any_clip(tmp_path):
    """From objects alone, with a round of DAgger, in which the planner says what was right."""
    see = InputConfig(body="proprio", clock=True, memory=True, elevation=False)
    imitate = stage_type("imitate", {"learner": "bc-clock"})(
        network=BCConfig(inputs=see, hidden=8, relative=True),
        train=TrainConfig(steps=3, batch=8),
        dagger=DaggerConfig(rounds=1, clips=2, driven=DrivenConfig(settle=0.0)),
    )
    demos = DemosConfig(expert="planner", starts="rule", clips=4, clean_share=1.0)
    recipe = Recipe("touch-points", objects=ObjectsConfig(count=4), demos=demos, imitate=imitate)
    stage = run_stage("imitate", recipe, tmp_path, CONTEXT)
    made = {path.name for path in (tmp_path / "touch-points").iterdir()}
    assert made == {"objects", "demos", "imitate"}, "no people, no retargeting"
    run = start(recipe, tmp_path, CONTEXT)
    folder = keys.demos_of(run, shipped_trackers("h1")["touch-points"])[1]
    kept = load_demos(folder / DATASET, "h1")
    assert 1 <= kept.episodes <= 4 and set(kept.reference_ids) <= {f"start-0-00000{i}" for i in range(4)}
    assert {motion.id for motion in demonstrated(run).motions} >= set(kept.reference_ids)
    verified = verify_demos(run)
    assert verified["fulfilled"] == kept.episodes, "found again in the states"
    driven = load_demos(stage.folder / "rounds" / "0" / DATASET, "h1", only_success=False)
    assert kept.gains == driven.gains == verified["gains"] == "improved", "those of the planner's tracker"
    assert driven.episodes and stage.summary["demonstrations"] == kept.episodes + driven.episodes
    _hit_says_what_they_did(replace(recipe, imitate=_small_hit()), tmp_path)


def _small_hit():
    network = replace(HITConfig.small(), encoder=TINY, hidden=16, heads=2, blocks=1, chunk=6)
    return HITImitation(network=network, train=TrainConfig(steps=2, batch=8))


def _hit_says_what_they_did(recipe, workdir):
    """Of who stands at the start of a demonstration to its end nothing would be near the robot."""
    stage = run_stage("imitate", recipe, workdir, CONTEXT)
    learner, _ = load_learner(stage.folder / "policy", H1, HITConfig)
    joints = len(H1.joints)
    root = slice(2 * joints, 2 * joints + 3)
    assert (learner.action_mean[0, root].abs() < 0.03).all() and (learner.action_std[0, root] < 0.03).all()

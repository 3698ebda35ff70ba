"""What the viewer lists, opens and works out. Its server: test_viewer_server.py; its page: test_viewer_page.py."""

import json
import queue
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import torch

from making import make, small
from mimicbench.core.errors import BadFile
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.evaluate.rows import EpisodeRow, write_rows
from mimicbench.imitate.lerobot import DATASET
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.objects.make import read_objects
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sensors.elevation import camera_map
from mimicbench.sensors.pictures import CameraPictures
from mimicbench.sensors.rays import ray_depth
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.rollout import RolloutConfig, track_clips

for name in ("viser", "mjviser"):
    pytest.importorskip(name, reason=f"{name} is not installed: pip install 'mimicbench[view]'")

from mimicbench.viewer.catalog import Catalog, ItemSet  # noqa: E402
from mimicbench.viewer.coloring import ColorCameras, Look  # noqa: E402
from mimicbench.viewer.figures import object_meshes, robot_meshes  # noqa: E402
from mimicbench.viewer.live import Episode  # noqa: E402
from mimicbench.viewer.methods import methods  # noqa: E402
from mimicbench.viewer.opened import open_item  # noqa: E402
from mimicbench.viewer.sensing import (  # noqa: E402
    CAMERA_PIXELS,
    Probe,
    camera_order,
    depth_picture,
    elevation,
    map_picture,
    side_by_side,
)
from mimicbench.viewer.showing import told_power  # noqa: E402

TASK, ROBOT = TASKS.get("sit-chair"), ROBOTS.get(DEFAULT_ROBOT)


@pytest.fixture(scope="module")
def workdir(tmp_path_factory):
    """Objects, references and retargeted clips, a demonstration and two episodes."""
    folder = tmp_path_factory.mktemp("work")
    clips = make("retarget", folder, small(clips=2))
    motion = RobotMotion.load(sorted(clips.folder.glob("*.npz"))[0])
    frames, joints = 5, len(ROBOT.joints)
    qpos = np.zeros((frames, 7 + joints))
    qpos[:, :3], qpos[:, 3:7], qpos[:, 7:] = motion.root_pos_w[:5], motion.root_quat_w[:5], motion.joint_pos[:5]
    qvel = np.full((frames, 6 + joints), 0.1)
    demo = Demonstration(
        np.zeros((frames, 3)), qpos[:, 7:], qpos[:, 7:] + 0.1, qpos, qvel, motion.object_id, motion.id, True
    )
    demos = folder / TASK.name / "demos" / "by-hand"
    writer = DemoWriter(demos / DATASET, ROBOT.name, TASK.name, ROBOT.joint_names)
    writer.add(demo)
    writer.finish()
    reads = {"retarget": f"retarget/{clips.folder.name}"}
    (demos / "header.json").write_text(json.dumps({"reads": reads}))
    rows = [
        row(motion, episode=0, success=True, stays=True, first_success_time=7.25),
        row(motion, episode=1, fell=True),
        row(motion, episode=2, success=True, first_success_time=5.0),
        row(motion, episode=3, end_distance=0.1),
        row(motion, episode=4, fell=True),
    ]
    write_rows(folder / TASK.name / "evaluate" / "tracker-0.parquet", rows)
    return folder


def row(motion, **changes):
    """A row of an episode that came to nothing, but for the changes."""
    plain = {
        "task": TASK.name, "stage": "track", "policy": "tracker", "preset": "improved", "robot": ROBOT.name, "seed": 0,
        "episode": 0, "object_id": motion.object_id, "object_kind": "dining", "split": "test",
        "reference_id": motion.id, "steps": 10, "success": False, "success_at_end": False, "stays": False,
        "first_success_time": None, "fell": False, "fell_time": None, "fell_phase": "", "diverged": False,
        "max_energy": 2.5e6, "seat_height": 0.45, "start_distance": 1.0, "end_distance": 0.5, "mimicbench": "0",
        "mujoco": "0",
    }  # fmt: skip
    if changes.get("fell"):
        changes |= {"fell_time": 3.0, "fell_phase": "walking"}
    return EpisodeRow(**{**plain, **changes})


def opened(workdir, kind, place=0):
    """An item of the first set of a kind."""
    catalog = Catalog(workdir)
    one = catalog.sets(TASK.name, kind)[0]
    return open_item(catalog, one, one.items[place])


def test_every_kind_is_listed(workdir):
    catalog = Catalog(workdir)
    assert catalog.tasks() == [TASK.name]
    assert catalog.kinds(TASK.name) == ["objects", "references", "retarget", "demos", "evaluate"]
    (rows,) = catalog.sets(TASK.name, "evaluate")
    assert rows.items == (
        "sit-chair-0-00000 tracker: K at 7.2 s",
        "sit-chair-0-00001 tracker: fell while walking",
        "sit-chair-0-00002 tracker: K at 5.0 s, did not stay",
        "sit-chair-0-00003 tracker: there, but not in place",
        "sit-chair-0-00004 tracker: fell while walking",
    )


def test_failed_episodes_are_picked_by_what_they_failed_of(workdir):
    (rows,) = Catalog(workdir).sets(TASK.name, "evaluate")
    assert rows.outcomes == ["any", "failed", "fell walking", "did not stay", "there, but not in place"]
    assert rows.matching("", "failed") == list(rows.items[1:])
    assert rows.matching("", "fell walking") == [rows.items[1], rows.items[4]]
    assert rows.matching("00004", "fell walking") == [rows.items[4]]
    assert rows.matching("00000", "failed") == []
    (clips,) = Catalog(workdir).sets(TASK.name, "retarget")
    assert clips.outcomes == ["any", "failed"] and len(clips.matching("")) == 2


def test_a_clip_brings_its_person_and_its_object(workdir):
    found = opened(workdir, "retarget")
    assert list(found.tracks) == ["human", "retargeted"]
    assert found.obj.id == found.clip.object_id
    human, robot = found.tracks.values()
    assert len(human) == len(robot) == found.clip.frames
    assert np.allclose(robot.pose(7).pos_w[0], found.clip.root_pos_w[7])


def test_a_reference_brings_what_was_made_of_it(workdir):
    found = opened(workdir, "references")
    assert list(found.tracks) == ["human", "retargeted"]
    assert found.clip.reference_id == found.name


@pytest.mark.parametrize("place", [0, 1])
def test_k_is_the_tasks_own(workdir, place):
    found = opened(workdir, "retarget", place)
    track = found.tracks["retargeted"]
    holds = TASK.held(found.clip, found.obj, ROBOT)
    assert [not track.lacks(i) for i in range(len(track))] == holds.tolist()
    assert (track.fulfilled() is not None) == TASK.fulfilled(found.clip, found.obj, ROBOT)
    first = track.fulfilled()
    needed = TASK.hold_frames(found.clip.fps)
    assert first is None or (holds[first - needed + 1 : first + 1].all() and not holds[first - needed])
    assert "pelvis" in track.lacks(0) and " cm " in track.lacks(0)


def test_the_human_fulfills_k_as_the_task_says(workdir):
    found = opened(workdir, "references")
    catalog = Catalog(workdir)
    one = catalog.sets(TASK.name, "references")[0]
    human = HumanMotion.load(one.file(one.items[0]))
    assert (found.tracks["human"].fulfilled() is not None) == TASK.fulfilled_by_human(human, found.obj)


def test_a_demonstration_has_what_its_joints_had_to_do(workdir):
    found = opened(workdir, "demos")
    track = found.tracks["robot"]
    curves = track.curves()
    gains = ROBOT.gains["improved"]
    limit = np.array([joint.torque_limit for joint in ROBOT.joints])
    # targets are 0.1 rad ahead, and all joints turn at 0.1 rad/s
    expected = np.clip(0.1 * np.array(gains.kp) - 0.1 * np.array(gains.kd), -limit, limit)
    assert np.allclose(curves.torque[2], expected)
    assert np.allclose(curves.effort[2], ((0.1 * expected) ** 2).sum())
    assert [curves.until(frame / 50) for frame in (0, 1, 2)] == [1, 2, 3], "stored states are told of as they begin"
    assert track.state(4).target.shape == (len(ROBOT.joints),)


def test_an_episode_says_who_is_to_act_it_out_again(workdir):
    found = opened(workdir, "evaluate", 1)
    assert found.policy == "tracker"
    assert "fell while walking" in found.facts[0] and "2.5e+06" in found.facts[0]


def test_an_episode_whose_motion_was_kept_is_played_as_it_was_judged(workdir):
    (rows,) = Catalog(workdir).sets(TASK.name, "evaluate")
    assert "robot" not in opened(workdir, "evaluate", 3).tracks, "this one was not kept"
    clip = opened(workdir, "evaluate", 3).clip
    file = rows.path.with_suffix("") / f"{rows.rows[3].id}.npz"
    replace(clip, id=rows.rows[3].id, fps=50.0).save(file)
    track = opened(workdir, "evaluate", 3).tracks["robot"]
    assert track.title == "tracker, as judged" and track.fps == 50 and len(track) == clip.frames
    assert np.allclose(track.pose(9).pos_w[0], clip.root_pos_w[9], atol=1e-6)
    file.unlink()


def test_twenty_thousand_items_are_listed_and_none_is_read(workdir, tmp_path):
    catalog = Catalog(workdir)
    clips = catalog.sets(TASK.name, "retarget")[0]
    many = tmp_path / "many"
    many.mkdir()
    for number in range(20_000):
        (many / f"sit-chair-9-{number:05d}.npz").touch()  # not one of them could be read
    (many / f"{clips.items[0]}.npz").write_bytes(clips.file(clips.items[0]).read_bytes())
    (many / "header.json").write_bytes((clips.path / "header.json").read_bytes())
    one = ItemSet(TASK.name, "retarget", many)
    start = time.process_time()
    assert len(one.items) == 20_001
    assert one.matching("9-00017") == ["sit-chair-9-00017"]
    assert open_item(catalog, one, clips.items[0]).name == clips.items[0]
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("name", ["../header", "/etc/passwd", "../../objects/x", "", ".", "header"])
def test_no_name_leads_out_of_a_set(workdir, name):
    one = Catalog(workdir).sets(TASK.name, "references")[0]
    with pytest.raises(BadFile):
        one.file(name)


def test_a_header_leads_nowhere_else(workdir, tmp_path):
    catalog = Catalog(workdir)
    (tmp_path / "header.json").write_text(json.dumps({"reads": {"objects": "../../../../etc"}}))
    with pytest.raises(BadFile, match="has no objects"):
        catalog.read_by(ItemSet(TASK.name, "retarget", tmp_path), "objects")


def test_an_empty_workdir_says_what_to_do(tmp_path):
    with pytest.raises(BadFile, match="mimicbench retarget"):
        Catalog(tmp_path)
    with pytest.raises(BadFile, match="does not exist"):
        Catalog(tmp_path / "nowhere")


def test_an_episode_is_the_one_that_is_judged(workdir):
    """The tracker does on the page, bit by bit, what it does when it makes demonstrations."""
    found = opened(workdir, "retarget")
    folder = methods(TASK.name, ROBOT.name, workdir)["tracker"]
    episode = Episode("tracker", folder, found)
    episode.until(0.5)
    objects = read_objects(Catalog(workdir).sets(TASK.name, "objects")[0].path)
    trimmed = ClipSet(TASK, ROBOT, [TASK.trimmed(found.clip, found.obj, ROBOT)], objects)
    rollout = track_clips(load_tracker(folder, ROBOT), trimmed, RolloutConfig(record=True, leave_fallen=True))
    expected = rollout.recording.qpos[0][:26, :3]
    assert len(episode.track) == 26
    assert np.array_equal(np.array([pose.pos_w[0] for pose in episode.track.poses], np.float32), expected)
    curves = episode.track.curves()
    assert np.isfinite(curves.effort).all() and curves.effort.max() > 0
    assert curves.time[-1] == pytest.approx(0.5)
    episode.close()


def test_a_push_pushes_and_the_map_is_the_robots_own(workdir):
    found = opened(workdir, "retarget")
    episode = Episode("tracker", methods(TASK.name, ROBOT.name, workdir)["tracker"], found)
    episode.until(0.3)
    before = episode.env.physics.qvel()[0, :3].copy()
    episode.push(np.array([0.5, -0.25, 0.0]))
    assert np.allclose(episode.env.physics.qvel()[0, :3] - before, (0.5, -0.25, 0.0))
    mine = elevation(TASK, found.obj, episode.track.poses[-1])
    theirs = camera_map(episode.env.physics, rig=TASK.rig, cell=TASK.map_cell)[0].numpy()
    assert np.allclose(mine, theirs, atol=1e-5)
    assert mine.max() - mine.min() > 0.3, "it sees the chair"
    picture = map_picture(mine, float(episode.track.poses[-1].pos_w[0, 2]))
    assert picture.shape == (128, 128, 3)
    now = episode.env.physics.qpos()[0]
    state = replace(episode.track.states[-1], qpos=now)
    seen = Probe().depth(ROBOT, found.obj, state, TASK.rig)
    theirs, without = (
        ray_depth(episode.env.physics, None, *CAMERA_PIXELS, rig=TASK.rig, robot=robot)[0] for robot in (True, False)
    )
    near = np.abs(seen - theirs) < 1e-3
    assert near.mean() > 0.97 and near[theirs == without].mean() > 0.998, "limbs are a step of physics older there"
    assert (theirs < 0.8 * without).any(), "it sees its own legs"
    picture = depth_picture(seen)
    assert picture.shape == (2 * 91, 2 * 121, 3) and picture.std() > 10, "four pictures, two in a row"
    assert depth_picture(seen[:3]).shape == picture.shape
    episode.close()


def test_the_floor_bears_the_robot(workdir):
    found = opened(workdir, "retarget")
    episode = Episode("tracker", methods(TASK.name, ROBOT.name, workdir)["tracker"], found)
    episode.until(1.0)
    weight, borne, probe = 9.81 * sum(link.mass for link in ROBOT.links), [], Probe()
    for frame in range(10, 50):
        arrows = probe.forces(ROBOT, found.obj, episode.track.state(frame))
        assert (arrows[:, 1, 2] > arrows[:, 0, 2]).all(), "forces act upwards on who stands"
        borne.append((arrows[:, 1] - arrows[:, 0])[:, 2].sum() * 1500)
    assert np.mean(borne) == pytest.approx(weight, rel=0.25)
    assert episode.track.state(len(episode.track) - 1) is episode.track.states[-1], "contacts are seen while it acts"
    episode.close()


def test_color_cameras_see_what_observations_show(workdir):
    found = opened(workdir, "retarget")
    episode = Episode("tracker", methods(TASK.name, ROBOT.name, workdir)["tracker"], found)
    episode.until(0.1)
    look = Look(ROBOT.name, TASK.name, found.obj, episode.env.physics.qpos()[0], found.wrist_goal_w)
    answers = queue.Queue()
    cameras = ColorCameras(answers.put)
    try:
        for _ in range(3):
            cameras.ask(look)
        seen = answers.get(timeout=120)
        if isinstance(seen, str):
            pytest.skip(seen)
        with closing(CameraPictures(ROBOT, TASK.rig, *CAMERA_PIXELS)) as pictures:
            theirs = pictures.views(episode.env.physics, torch.full((1, 2, 3), torch.nan)).color[0]
        assert np.array_equal(seen, theirs[camera_order(TASK.rig)])
        assert seen.std() > 10 and side_by_side(seen).shape == (2 * 91, 2 * 121, 3)
    finally:
        cameras.close()
        episode.close()


def test_without_opengl_the_color_cameras_say_so(workdir, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    found, answers = opened(workdir, "retarget"), queue.Queue()
    cameras = ColorCameras(answers.put)
    qpos = np.zeros(7 + len(ROBOT.joints) + 7)
    cameras.ask(Look(ROBOT.name, TASK.name, found.obj, qpos, found.wrist_goal_w))
    assert "no OpenGL" in answers.get(timeout=120)
    cameras.close()


def test_power_is_told_against_every_limit():
    assert told_power(9e5).endswith("P holds for every λ")
    assert told_power(2e6).endswith("P holds for λ = 4e6, 8e6")
    assert told_power(9e6).endswith("P holds for no λ")


def test_bodies_have_their_sizes(workdir):
    found = opened(workdir, "objects")
    (mesh,) = object_meshes(found.obj).values()
    assert np.allclose(mesh.bounds, found.obj.bounds(), atol=1e-6)
    meshes = robot_meshes(ROBOT, found.obj)
    assert 0 in meshes and sum(len(one.faces) for one in meshes.values()) < 30_000
    assert all((one.extents < 1.0).all() for one in meshes.values())

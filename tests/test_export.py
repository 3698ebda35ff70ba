"""What goes to other programs: scenes as MJCF that MuJoCo reads again, clips in the files of other trackers."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mimicbench.cli import main
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, BadMotion, BadObject, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.tracking_file import tracking_arrays, write_tracking_file
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.make import find_object
from mimicbench.objects.shape import save_object
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.mjcf import START, scene_xml
from mimicbench.sim.scene import build_model
from stool import block

WEDGE = np.array([(x, y, z) for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.3 + x)])
OBJECTS = {"chair": make_chair(0), "box": make_box(0), "wedge": replace(block(), hulls=(WEDGE,))}
LAYOUT = {
    "joint_pos": ("N",),
    "joint_vel": ("N",),
    "body_pos_w": ("L", 3),
    "body_quat_w": ("L", 4),
    "body_lin_vel_w": ("L", 3),
    "body_ang_vel_w": ("L", 3),
}


@pytest.fixture(params=list(ROBOTS))
def robot(request):
    return ROBOTS.get(request.param)


def at_start(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
    return data


@pytest.mark.parametrize("obj", OBJECTS.values(), ids=OBJECTS)
def test_a_scene_loaded_again_moves_as_ours_does(robot, obj, tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(scene_xml(robot, obj))
    loaded, ours = mujoco.MjModel.from_xml_path(str(path)), build_model(robot, obj)
    theirs, data = at_start(loaded), mujoco.MjData(ours)
    data.qpos[:], data.ctrl[:] = theirs.qpos, theirs.ctrl
    random = np.random.default_rng(0)
    for _ in range(100):
        theirs.ctrl[:] = data.ctrl[:] = np.array(robot.rest_pose) + 0.1 * random.normal(size=ours.nu)
        mujoco.mj_step(loaded, theirs)
        mujoco.mj_step(ours, data)
    assert np.abs(data.qpos - theirs.qpos).max() < 2e-3, "six digits, and contacts"
    assert np.abs(data.qpos[7 : 7 + ours.nu] - robot.rest_pose).max() > 0.01, "something moved"


def test_in_flight_only_six_digits_tell_them_apart(robot):
    obj = OBJECTS["chair"]
    loaded, ours = mujoco.MjModel.from_xml_string(scene_xml(robot, obj, visuals=False)), build_model(robot, obj)
    ends = []
    for model in (loaded, ours):
        data = mujoco.MjData(model)
        data.qpos[:] = 3.0, 0.0, 3.0, *rot.IDENTITY, *robot.rest_pose
        data.ctrl[:] = 0.5 * np.array(robot.rest_pose)
        mujoco.mj_step(model, data, 60)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    np.testing.assert_allclose(*ends, atol=2e-4)
    assert loaded.opt.timestep == ours.opt.timestep and loaded.ngeom == ours.ngeom


def test_the_robot_stands_before_the_object_until_it_topples(robot):
    model = mujoco.MjModel.from_xml_string(scene_xml(robot, OBJECTS["chair"]))
    assert [model.actuator(i).name for i in range(model.nu)] == list(robot.joint_names)
    data = at_start(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qpos[:7], model.qpos0[:7])
    assert data.ncon == 0
    height = data.qpos[2]
    mujoco.mj_step(model, data, 60)  # 0.3 s: it settles on its soles
    assert height - 0.05 < data.qpos[2] < height
    mujoco.mj_step(model, data, round(4.0 / model.opt.timestep))
    assert data.qpos[2] < height - 0.2, "the servos aim at the pose, and nobody balances"


def test_gains_that_a_robot_does_not_have():
    with pytest.raises(UnknownName, match="known are: improved, paper"):
        scene_xml(ROBOTS.get("h1"), OBJECTS["chair"], "fast")


def test_objects_by_id_and_by_file(tmp_path):
    assert find_object("chair-0-00007").id == make_chair(7).id
    save_object(tmp_path, OBJECTS["wedge"])
    assert len(find_object(str(tmp_path / f"{OBJECTS['wedge'].id}.json")).hulls) == 1
    for name in ("chair", "chair-0-x", "../chair"):
        with pytest.raises(BadObject, match="no object's id such as chair-0-00042"):
            find_object(name)
    with pytest.raises(BadObject, match="the one of those numbers is 'chair-0-00007'"):
        find_object("chair-0-7")
    with pytest.raises(UnknownName, match="known are: bed"):
        find_object("throne-0-00001")
    with pytest.raises(BadFile, match="does not exist"):
        find_object(str(tmp_path / "own-chair-no-1.json"))


def waving(robot, frames=60, fps=30.0):
    """A clip in which everything moves, as smoothly as the clips of people do."""
    time = np.arange(frames)[:, None] / fps
    phase = np.linspace(0, 3, len(robot.joints))
    span = 0.3 * np.minimum(robot.joint_range[:, 1] - robot.rest_pose, robot.rest_pose - robot.joint_range[:, 0])
    turn = rot.multiply(rot.from_yaw(0.8 * time[:, 0]), rot.from_rotvec(0.3 * np.sin(time + [0.0, 1.0, 2.0])))
    return RobotMotion(
        "waving",
        "sit-chair",
        robot.name,
        robot.joint_names,
        fps,
        np.concatenate([0.5 * time, 0.1 * np.sin(time), 0.9 + 0.05 * np.cos(3 * time)], -1),
        turn,
        np.array(robot.rest_pose) + span * np.sin(2 * time + phase),
        "chair-0-00000",
        "waving",
    )


def test_a_tracking_file_has_the_documented_layout(robot, tmp_path):
    motion, path = waving(robot), tmp_path / "waving.npz"
    written = write_tracking_file(path, motion, robot)
    sizes = {"N": len(robot.joints), "L": len(robot.links)}
    with np.load(path, allow_pickle=False) as found:
        assert set(found.files) == {*LAYOUT, "fps", "joint_names", "body_names"}
        assert found["fps"].tolist() == [50]
        for name, shape in LAYOUT.items():
            assert found[name].shape == (99, *(sizes.get(size, size) for size in shape)), name
            assert found[name].dtype == np.float32
            np.testing.assert_array_equal(found[name], written[name])
        assert tuple(found["joint_names"]) == robot.joint_names and tuple(found["body_names"]) == robot.link_names
    again = tmp_path / "again.npz"
    write_tracking_file(again, motion, robot)
    assert again.read_bytes() == path.read_bytes()


def test_velocities_are_finite_differences(robot):
    found = {
        name: np.asarray(array, float)
        for name, array in tracking_arrays(waving(robot), robot).items()
        if name[-5:] != "names"
    }
    inner = slice(3, -3)  # the splines' ends are straight, and the last frame is at rest
    for place, velocity in (("joint_pos", "joint_vel"), ("body_pos_w", "body_lin_vel_w")):
        by_hand = np.gradient(found[place], 1 / 50, axis=0)
        np.testing.assert_allclose(found[velocity][inner], by_hand[inner], atol=0.02)
        assert np.abs(by_hand[inner]).max() > 0.5
    before, after = found["body_quat_w"][:-2], found["body_quat_w"][2:]
    spin = rot.to_rotvec(rot.multiply(after, rot.conjugate(before))) * 25
    np.testing.assert_allclose(found["body_ang_vel_w"][1:-1][inner], spin[inner], atol=0.02)
    assert np.abs(spin).max() > 0.5


def test_bodies_are_where_mujoco_has_them(robot):
    found = tracking_arrays(waving(robot), robot)
    model = build_model(robot, OBJECTS["chair"])
    data = mujoco.MjData(model)
    rows = [model.body(name).id for name in found["body_names"]]
    for frame in (0, 40):
        data.qpos[:] = *found["body_pos_w"][frame, 0], *found["body_quat_w"][frame, 0], *found["joint_pos"][frame]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(found["body_pos_w"][frame], data.xpos[rows], atol=1e-5)
        np.testing.assert_allclose(
            rot.angle_between(found["body_quat_w"][frame].astype(float), data.xquat[rows]), 0, atol=2e-3
        )


def test_clips_that_cannot_be_written():
    robot = ROBOTS.get("h1")
    with pytest.raises(BadMotion, match="two frames at 50 Hz need more"):
        tracking_arrays(waving(robot, frames=2, fps=200.0), robot)
    with pytest.raises(BadMotion, match="retarget it again"):
        tracking_arrays(waving(robot), ROBOTS.get("g1"))


def test_the_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["export", "scene", "chair-0-00002", "--robot", "g1", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["file"] == "g1-chair-0-00002.xml" and mujoco.MjModel.from_xml_path(told["file"]).nu == 29
    waving(ROBOTS.get("h1")).save(tmp_path / "clip.npz")
    main(["export", "motion", "clip.npz", "--out", "there.npz", "--json"])
    assert json.loads(capsys.readouterr().out) == {
        "file": "there.npz",
        "robot": "h1",
        "frames": 99,
        "bodies": 20,
        "fps": 50,
    }
    with pytest.raises(SystemExit):
        main(["export", "motion", "nowhere.npz"])
    assert "nowhere.npz does not exist" in capsys.readouterr().err

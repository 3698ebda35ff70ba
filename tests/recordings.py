"""Writes one made-up motion in every format that can be imported, with that format's own rest pose, axes, units and
order of things.
"""

from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.references.body.skeletons import CORE4D, ROAM, UNIHSI

FRAMES = 45
Y_UP = rot.from_matrix(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]))  # (x, y, z) with z up becomes (y, z, x)
SMPL_FRAME = rot.conjugate(Y_UP)  # a frame with y up and z forward, in one with z up and x forward
UNITY_FRAME = rot.multiply(SMPL_FRAME, np.array([0.0, 0.0, 1.0, 0.0]))  # turned half round about its y axis
ARMS = {
    "roam": ("Arm", "ForeArm", "Hand"),
    "core4d": ("shoulder", "elbow", "wrist"),
    "unihsi": (),
}


def made_up(
    skeleton: Skeleton, frames: int = FRAMES, seed: int = 0, fps: float = 30.0
) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3) and local rotations (T, J, 4) of somebody who stands on straight legs at first, then moves all
    joints a little.
    """
    random = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / fps
    swing = (
        0.25
        * np.sin(2 * np.pi * 0.7 * time + random.uniform(0, 2, (1, len(skeleton.parents), 1)))
        * random.uniform(-1, 1, (1, len(skeleton.parents), 3))
    )
    ends = [j for j, name in enumerate(skeleton.joint_names) if "Site" in name or ("ToeBase" in name)]
    swing[:, ends] = 0.0
    quat = rot.from_rotvec(swing * np.minimum(time, 1.0))
    leg = [
        j
        for j, name in enumerate(skeleton.joint_names)
        if name in ("left_shin", "left_foot", "left_knee", "left_ankle", "LeftLeg", "LeftFoot")
    ]
    height = -skeleton.offsets[leg, 2].sum() + 0.12
    root = np.concatenate(
        [0.3 + 0.1 * time[:, 0], -0.2 + 0.05 * time[:, 0], height + 0.01 * np.sin(3 * time[:, 0])], -1
    )
    return root, quat


def swings(skeleton: Skeleton) -> np.ndarray:
    """(J, 4) how a T-pose's arms are turned to hang: the left ones by -90 degrees about x, the right ones by 90."""
    found = np.tile(rot.IDENTITY, (len(skeleton.parents), 1))
    for j, name in enumerate(skeleton.joint_names):
        for side, angle in (("left", -np.pi / 2), ("right", np.pi / 2)):
            if name.lower().startswith(side) and name.lower().removeprefix(side).strip("_") in [
                arm.lower() for arm in ARMS[skeleton.name]
            ]:
                found[j] = rot.from_rotvec(np.array([angle, 0.0, 0.0]))
    return found


def theirs(
    skeleton: Skeleton, root: np.ndarray, quat: np.ndarray, frame: np.ndarray, world: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """World positions and orientations as a source has them that rests in a T-pose, with its own frames and its own
    world.
    """
    pos, ours = forward_kinematics(skeleton, root, quat)
    return rot.rotate(world, pos), rot.multiply(world, rot.multiply(ours, rot.multiply(swings(skeleton), frame)))


def local(skeleton: Skeleton, world: np.ndarray) -> np.ndarray:
    """Rotations relative to the parents."""
    return np.stack(
        [
            world[:, j] if p < 0 else rot.multiply(rot.conjugate(world[:, p]), world[:, j])
            for j, p in enumerate(skeleton.parents)
        ],
        1,
    )


def skeleton_motion(path: Path, fps: float = 30.0, frames: int = FRAMES) -> Path:
    root, quat = made_up(UNIHSI, frames)
    data = {
        "__name__": "SkeletonMotion",
        "is_local": True,
        "fps": fps,
        "rotation": {"arr": quat[..., [1, 2, 3, 0]].astype(np.float32)},
        "root_translation": {"arr": root.astype(np.float32)},
        "skeleton_tree": {
            "node_names": list(UNIHSI.joint_names),
            "parent_indices": {"arr": np.array(UNIHSI.parents)},
            "local_translation": {"arr": UNIHSI.offsets.astype(np.float32)},
        },
    }
    np.save(path, np.array(data, dtype=object), allow_pickle=True)
    return path


def states(path: Path, fps: float = 30.0, frames: int = FRAMES) -> Path:
    pos, quat = forward_kinematics(UNIHSI, *made_up(UNIHSI, frames))
    velocity = np.gradient(pos, 1 / fps, axis=0)
    table = np.concatenate([pos, quat[..., [1, 2, 3, 0]], velocity, rot.angular_velocity(quat, fps)], -1).astype(
        np.float32
    )
    np.savez(path, states=table) if path.suffix == ".npz" else np.save(path, table)
    return path


def roam_dump(path: Path, velocity: bool = True, frames: int = FRAMES) -> Path:
    pos, quat = theirs(ROAM, *made_up(ROAM, frames), UNITY_FRAME, Y_UP)
    parts = [pos, rot.rotate(quat, np.array([0.0, 0, 1])), rot.rotate(quat, np.array([0.0, 1, 0]))]
    table = np.concatenate(parts + ([np.gradient(pos, 1 / 25, axis=0)] if velocity else []), -1)
    np.save(path, table) if path.suffix == ".npy" else np.savetxt(path, table.reshape(frames, -1), fmt="%.7f")
    return path


def random_frames() -> np.ndarray:
    """(27, 4) frames of ROAM's joints with which nobody stands in the zero pose."""
    return rot.normalize(np.random.default_rng(1).standard_normal((27, 4)))


def bvh(
    path: Path,
    unit: float = 0.001,
    order: str = "XYZ",
    frame_time: float = 1 / 30,
    rename=lambda name: name,
    drop=(),
    joint_frames=None,
    motion=None,
    hip_joint=None,
    frames: int = FRAMES,
) -> Path:
    """ROAM's skeleton in a T-pose, y up; `unit` in meters; with a finger at each hand.

    `joint_frames` (27, 4) make another zero pose of it, `motion` is another one than the made-up one, and with
    `hip_joint` (T, 4), local rotations, joints between pelvis and thighs turn so.
    """
    root, quat = made_up(ROAM, frames) if motion is None else motion
    frames = len(root)
    pos, world = theirs(ROAM, root, quat, SMPL_FRAME, Y_UP)
    rest = rot.multiply(swings(ROAM), np.tile(SMPL_FRAME, (27, 1)))
    if joint_frames is not None:
        world, rest = rot.multiply(world, joint_frames), rot.multiply(rest, joint_frames)
    turns = local(ROAM, world)
    children = {j: [i for i, p in enumerate(ROAM.parents) if p == j] for j in range(27)}
    lines, columns = ["HIERARCHY"], []
    rotations = " ".join(f"{axis}rotation" for axis in order)

    def angles(quat) -> np.ndarray:
        return Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_euler(order, degrees=True)

    def head(kind: str, name: str, offset, channels: str, pad: str) -> None:
        lines.extend(
            [f"{pad}{kind} {name}".rstrip(), f"{pad}{{", f"{pad}\tOFFSET {' '.join(f'{x:.7f}' for x in offset)}"]
        )
        lines.extend([f"{pad}\tCHANNELS {channels}"] if channels else [])

    def write(j: int, depth: int) -> None:
        name, pad = ROAM.joint_names[j], "\t" * depth
        offset = np.zeros(3) if j == 0 else rot.rotate_inverse(rest[ROAM.parents[j]], ROAM.offsets[j]) / unit
        if name.endswith("Site"):
            head("End Site", "", offset, "", pad)
            lines.append(f"{pad}}}")
            return
        between = hip_joint is not None and name.endswith("UpLeg")
        if between:
            head("JOINT", f"{name[0]}HipJoint", np.zeros(3), f"3 {rotations}", pad)
            columns.append(angles(hip_joint))
            turns[:, j] = rot.multiply(rot.conjugate(hip_joint), turns[:, j])
        places = "6 Xposition Yposition Zposition" if j == 0 else "3"
        head("JOINT" if j else "ROOT", rename(name), offset, f"{places} {rotations}", pad)
        if j == 0:
            columns.append(pos[:, 0] / unit)
        columns.append(angles(turns[:, j]))
        for child in children[j]:
            if ROAM.joint_names[child] not in drop:
                write(child, depth + 1)
        if name.endswith("Hand"):
            head("JOINT", f"{rename(name)}Index1", (80, 0, 0), f"3 {rotations}", f"{pad}\t")
            head("End Site", "", (30, 0, 0), "", f"{pad}\t\t")
            lines.extend([f"{pad}\t\t}}", f"{pad}\t}}"])
            columns.append(np.full((frames, 3), 5.0))
        lines.extend([f"{pad}}}"] * (1 + between))

    write(0, 0)
    table = np.concatenate(columns, -1)
    lines += [
        "MOTION",
        f"Frames: {frames}",
        f"Frame Time: {frame_time:.7f}",
        *(" ".join(f"{x:.6f}" for x in row) for row in table),
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def core4d(path: Path, with_object: bool = False, frames: int = FRAMES) -> Path:
    pos, world = theirs(CORE4D, *made_up(CORE4D, frames), SMPL_FRAME, Y_UP)
    rotvec = rot.to_rotvec(local(CORE4D, world)).astype(np.float32)
    joints = np.zeros((frames, 127, 3), np.float32)
    joints[:, :22] = pos
    person = {
        "betas": np.zeros((frames, 10), np.float32),
        "global_orient": rotvec[:, 0],
        "transl": pos[:, 0].astype(np.float32),
        "body_pose": rotvec[:, 1:],
        "left_hand_pose": np.zeros((frames, 12), np.float32),
        "joints": joints,
        "vertices": np.zeros((frames, 7, 3), np.float32),
    }
    np.savez(path, np.array(person, dtype=object))
    if with_object:
        poses = np.tile(np.eye(4), (frames, 1, 1))
        poses[:, :3, 3] = pos[:, 20:22].mean(1)
        np.save(path.with_name("smooth_objposes.npy"), poses)
    return path


def amass(path: Path, kind: str = "smplh", joints: bool = True, fps: float = 30.0, frames: int = FRAMES) -> Path:
    pos, world = theirs(CORE4D, *made_up(CORE4D, frames), SMPL_FRAME, rot.IDENTITY)
    rotvec = rot.to_rotvec(local(CORE4D, world)).reshape(frames, -1)
    trans, more = pos[:, 0] - np.array([0.0, -0.35, 0.01]), {"joints": pos.astype(np.float32)} if joints else {}
    if kind == "smplx":
        np.savez(
            path,
            root_orient=rotvec[:, :3],
            pose_body=rotvec[:, 3:66],
            trans=trans,
            mocap_frame_rate=fps,
            gender="neutral",
            betas=np.zeros(16),
            **more,
        )
    else:
        poses = np.concatenate([rotvec, np.zeros((frames, {"smpl": 72, "smplh": 156}[kind] - 66))], -1)
        np.savez(
            path, poses=poses, trans=trans, mocap_framerate=fps, gender=np.array("male"), betas=np.zeros(10), **more
        )
    return path


def intermimic(path: Path, frames: int = FRAMES) -> Path:
    pos, world = theirs(CORE4D, *made_up(CORE4D, frames), rot.IDENTITY, rot.IDENTITY)
    places = (0, 1, 5, 9, 2, 6, 10, 3, 7, 11, 4, 8, 12, 14, 33, 13, 15, 34, 16, 35, 17, 36)
    table = np.zeros((frames, 591))
    bodies, quats = np.zeros((frames, 52, 3)), np.tile([0.0, 0, 0, 1], (frames, 52, 1))
    bodies[:, list(places)], quats[:, list(places)] = pos, world[..., [1, 2, 3, 0]]
    table[:, 0:3], table[:, 3:7] = bodies[:, 0], quats[:, 0]
    table[:, 162:318], table[:, 383:591] = bodies.reshape(frames, -1), quats.reshape(frames, -1)
    table[:, 318:321], table[:, 321:325] = pos[:, 20:22].mean(1), (0, 0, 0, 1)
    torch.save(torch.tensor(table, dtype=torch.float32), path)
    return path


WRITERS = {
    "unihsi": lambda folder: skeleton_motion(folder / "clip.npy"),
    "unihsi-states": lambda folder: states(folder / "states.npz"),
    "roam": lambda folder: roam_dump(folder / "bones.txt"),
    "core4d": lambda folder: core4d(folder / "person1_poses.npz", with_object=True),
    "amass": lambda folder: amass(folder / "amass.npz"),
    "bvh": lambda folder: bvh(folder / "take.bvh"),
    "intermimic": lambda folder: intermimic(folder / "omomo.pt"),
}
SKELETONS = {
    "unihsi": UNIHSI,
    "unihsi-states": UNIHSI,
    "roam": ROAM,
    "core4d": CORE4D,
    "amass": CORE4D,
    "bvh": ROAM,
    "intermimic": CORE4D,
}

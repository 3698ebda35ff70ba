"""Rotations: the axioms of a group, the same answers from NumPy and torch, and resampling."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mimicbench.core import rotations as rot

number = st.floats(-10, 10, allow_subnormal=False)
vectors = st.tuples(number, number, number).map(np.array)
quats = (
    st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4)
    .map(np.array)
    .filter(lambda q: (q**2).sum() > 1e-3)
    .map(rot.normalize)
)


def scipy_rotation(q):
    return Rotation.from_quat(q[..., [1, 2, 3, 0]])


def close(a, b, atol=1e-9):
    np.testing.assert_allclose(a, b, atol=atol, rtol=0)


def same_turn(a, b, atol=1e-7):
    close(rot.angle_between(a, b), 0, atol)


@settings(max_examples=60, deadline=None)
@given(quats, quats, quats, vectors, vectors)
def test_axioms(a, b, c, v, w):
    close(rot.multiply(rot.multiply(a, b), c), rot.multiply(a, rot.multiply(b, c)))
    close(rot.multiply(a, rot.conjugate(a)), rot.IDENTITY)
    close(rot.multiply(a, rot.IDENTITY), a)
    # a rotation acts on vectors as the group does, and keeps lengths and handedness
    close(rot.rotate(rot.multiply(a, b), v), rot.rotate(a, rot.rotate(b, v)), 1e-8)
    close(rot.rotate_inverse(a, rot.rotate(a, v)), v, 1e-8)
    close(rot.rotate(a, v) @ rot.rotate(a, w), v @ w, 1e-7)
    close(rot.rotate(a, np.cross(v, w)), np.cross(rot.rotate(a, v), rot.rotate(a, w)), 1e-7)
    close(rot.rotate(-a, v), rot.rotate(a, v))


@settings(max_examples=60, deadline=None)
@given(quats, quats, vectors)
def test_agrees_with_scipy(a, b, v):
    close(rot.rotate(a, v), scipy_rotation(a).apply(v), 1e-8)
    close(rot.to_matrix(a), scipy_rotation(a).as_matrix())
    close(rot.to_6d(a).reshape(2, 3).T, scipy_rotation(a).as_matrix()[:, :2])
    close(rot.angle_between(a, b), (scipy_rotation(a).inv() * scipy_rotation(b)).magnitude(), 1e-7)
    same_turn(rot.from_matrix(rot.to_matrix(a)), a)


@settings(max_examples=60, deadline=None)
@given(quats)
def test_rotation_vectors(q):
    r = rot.to_rotvec(q)
    assert np.linalg.norm(r) <= np.pi + 1e-9, "the shorter way"
    same_turn(rot.from_rotvec(r), q)
    close(np.linalg.norm(r), rot.angle_between(q, rot.IDENTITY), 1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-4, 1e-3, 1.0, np.pi - 1e-9])
def test_small_and_large_turns_keep_their_digits(angle):
    axis = np.array([0.6, 0.0, 0.8])
    close(rot.to_rotvec(rot.from_rotvec(axis * angle)), axis * angle, 1e-15 + 1e-9 * angle)


def test_half_turns_back_from_matrices():
    # where w = 0, and each other component is largest in turn
    for axis in np.concatenate([np.eye(3), np.ones((1, 3)) / np.sqrt(3), [[0.6, -0.8, 0.0]]]):
        matrix = 2 * np.outer(axis, axis) - np.eye(3)
        close(rot.to_matrix(rot.from_matrix(matrix)), matrix)


@settings(max_examples=40, deadline=None)
@given(st.lists(quats, min_size=2, max_size=4), vectors, st.floats(0, 1))
def test_numpy_and_torch_agree(qs, v, t):
    a, b = np.array(qs), np.array(qs[::-1])
    tensors = torch.tensor(a), torch.tensor(b)
    vs, ts = np.broadcast_to(v, (len(a), 3)).copy(), np.full(len(a), t)
    calls = {
        "multiply": ((a, b), tensors),
        "conjugate": ((a,), tensors[:1]),
        "rotate": ((a, vs), (tensors[0], torch.tensor(vs))),
        "rotate_inverse": ((a, vs), (tensors[0], torch.tensor(vs))),
        "from_rotvec": ((vs,), (torch.tensor(vs),)),
        "to_rotvec": ((a,), tensors[:1]),
        "angle_between": ((a, b), tensors),
        "to_matrix": ((a,), tensors[:1]),
        "to_6d": ((a,), tensors[:1]),
        "yaw_of": ((a,), tensors[:1]),
        "from_yaw": ((vs[:, 0],), (torch.tensor(vs[:, 0]),)),
        "slerp": ((a, b, ts), (*tensors, torch.tensor(ts))),
        "normalize": ((3 * a,), (3 * tensors[0],)),
    }
    for name, (arrays, theirs) in calls.items():
        ours, other = getattr(rot, name)(*arrays), getattr(rot, name)(*theirs)
        assert isinstance(other, torch.Tensor), name
        close(ours, other.numpy(), 1e-8)


def test_precision_is_kept():
    q = rot.normalize(np.array([[0.3, -0.5, 0.1, 0.8], [1, 0, 0, 0]], np.float32))
    v = np.ones((2, 3), np.float32)
    for result in (
        rot.multiply(q, q),
        rot.rotate(q, v),
        rot.to_rotvec(q),
        rot.from_rotvec(v),
        rot.to_6d(q),
        rot.slerp(q, q, v[:, 0]),
        rot.from_yaw(v[:, 0]),
    ):
        assert result.dtype == np.float32
    assert rot.to_rotvec(torch.tensor(q)).dtype == torch.float32


@settings(max_examples=60, deadline=None)
@given(quats, quats, st.floats(0, 1))
def test_slerp_turns_evenly_along_the_shortest_way(a, b, t):
    whole = rot.angle_between(a, b)
    between = rot.slerp(a, b, np.array(t))
    close(rot.angle_between(a, between), t * whole, 1e-6)
    close(rot.angle_between(between, b), (1 - t) * whole, 1e-6)


@settings(max_examples=60, deadline=None)
@given(st.floats(-20, 20))
def test_yaw(yaw):
    found = rot.yaw_of(rot.from_yaw(np.array(yaw)))
    close(found, rot.wrap_angle(np.array(yaw)) if abs(abs(found) - np.pi) > 1e-6 else found, 1e-7)
    assert -np.pi <= rot.wrap_angle(np.array(yaw)) < np.pi


def test_angular_velocity_of_a_steady_turn():
    axis, rate, fps = np.array([0.0, 0.6, 0.8]), 1.5, 50.0
    quat = rot.from_rotvec(np.arange(20)[:, None] / fps * rate * axis)
    close(rot.angular_velocity(quat, fps), np.broadcast_to(rate * axis, (20, 3)), 1e-6)
    close(
        rot.angular_velocity(-quat * (-1.0) ** np.arange(20)[:, None], fps), np.broadcast_to(rate * axis, (20, 3)), 1e-6
    )


def test_resample_keeps_straight_lines_and_steady_turns():
    times = np.arange(31) / 30
    line = np.stack([times, 2 - times], -1)
    again = rot.resample(line, 30, 50)
    assert len(again) == 51
    close(again, np.stack([np.arange(51) / 50, 2 - np.arange(51) / 50], -1))
    turn = rot.from_rotvec(times[:, None] * np.array([0.0, 0.0, 1.2]))
    same_turn(rot.resample_quat(turn, 30, 50), rot.from_rotvec(np.arange(51)[:, None] / 50 * np.array([0.0, 0.0, 1.2])))


def test_resample_of_joints_and_of_one_frame():
    quats = np.tile(rot.IDENTITY, (10, 3, 1))
    assert rot.resample_quat(quats, 30, 50).shape == (16, 3, 4)
    assert rot.resample(np.ones((1, 2)), 30, 50).shape == (1, 2)
    close(rot.resample(np.arange(5.0)[:, None], 50, 50)[:, 0], np.arange(5.0))


@settings(max_examples=60, deadline=None)
@given(quats)
def test_two_columns_are_a_rotation(q):
    same_turn(rot.from_6d(rot.to_6d(q)), q)
    same_turn(rot.from_6d(torch.from_numpy(rot.to_6d(q))).numpy(), q)
    # of any length, and not quite at right angles
    bent = rot.to_6d(q) * np.repeat([0.5, 3.0], 3)
    bent[3:] += 0.2 * bent[:3]
    same_turn(rot.from_6d(bent), q)

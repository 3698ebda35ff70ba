"""Least squares over a whole clip: damped Gauss-Newton steps on a banded matrix, within joint limits.

The unknowns are the V = 6 + N numbers (dp, dw, dq) of each of T frames (see kinematics.py). Frames meet only in
differences of a coordinate over time, which join it at up to three successive frames, so the matrix is block-diagonal
plus a few diagonals and a banded Cholesky factorization costs the same for each frame, however long the clip. Joint
limits hold exactly: joints that would leave them are held at them and the others solved for again.
"""

from typing import Protocol

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.retarget.kinematics import Links, Pose, Tree

_START_DAMPING, _MOST_DAMPING = 1e-4, 1e6
"""Of a step, as a share of the matrix' diagonal. It follows how much of what the quadratic promises a step gains
(Marquardt 1963)."""


class Objective(Protocol):
    """What is minimized."""

    @property
    def tree(self) -> Tree:
        """The robot's."""
        ...

    @property
    def limits(self) -> np.ndarray:
        """(N, 2) of the joints [rad]."""
        ...

    def loss(self, pose: Pose, links: Links) -> float:
        """Its value."""
        ...

    def model(self, pose: Pose, links: Links) -> "Model":
        """A quadratic that touches it at the pose and, for majorizers, lies above it."""
        ...


class Model:
    """The symmetric matrix of a quadratic as its lower band, and its gradient."""

    def __init__(self, blocks: np.ndarray, gradient: np.ndarray) -> None:
        """From the frames' own blocks (T, V, V) and gradient (T, V)."""
        frames, variables = gradient.shape
        self.gradient = gradient
        self.band = np.zeros((2 * variables + 1, frames, variables))
        row, column = np.tril_indices(variables)
        self.band[row - column, :, column] = blocks[:, row, column].T

    def add_differences(
        self, columns: np.ndarray, stencil: np.ndarray, values: np.ndarray, weights: np.ndarray
    ) -> None:
        """Add sum w (s_0 x_t + s_1 x_t+1 + ...)^2 / 2 over all t, of which the differences are now `values`.

        Args:
            columns: (C,) which variables of a frame.
            stencil: (2,) or (3,) s, per frame rate to the power of its order.
            values: (T - 1, C) or (T - 2, C) differences.
            weights: the same shape.
        """
        count, variables = len(values), self.gradient.shape[1]
        for i in range(len(stencil)):
            self.gradient[i : count + i, columns] += stencil[i] * weights * values
            for j in range(i, len(stencil)):
                self.band[(j - i) * variables, i : count + i, columns] += stencil[i] * stencil[j] * weights.T


def solve(
    objective: Objective, start: Pose, iterations: int, tolerance: float, patience: int = 1
) -> tuple[Pose, list[float]]:
    """Minimize from a start, which is clipped to the limits. Returns the state and the loss after each step taken.

    Stops after `iterations` steps, or when each of the last `patience` ones, on average, lowers the loss by less than
    `tolerance` of it.
    """
    limits, variables = objective.limits, 6 + len(objective.limits)
    pose = start._replace(joints=np.clip(start.joints, limits[:, 0], limits[:, 1]))
    links = objective.tree.place(pose)
    losses, damping = [objective.loss(pose, links)], _START_DAMPING
    for _ in range(iterations):
        model = objective.model(pose, links)
        band, gradient = model.band.reshape(len(model.band), -1), model.gradient.ravel()
        rejected = False
        while True:
            step = _bounded_step(band, gradient, damping, limits, pose.joints)
            promised = -0.5 * float(gradient @ step)  # what the quadratic says that the step gains
            if rejected and promised < tolerance * losses[-1]:
                return pose, losses
            moved = move(pose, step.reshape(-1, variables), limits)
            moved_links = objective.tree.place(moved)
            value = objective.loss(moved, moved_links)
            if value < losses[-1]:
                break
            if not damping <= _MOST_DAMPING:
                return pose, losses  # so too if the value is NaN
            rejected = True
            damping = max(damping * (10.0 if value < 1.5 * losses[-1] else 100.0), _START_DAMPING)
        gained = (losses[-1] - value) / max(promised, 1e-300)
        damping = max(damping * (0.1 if gained > 0.75 else 0.5 if gained > 0.25 else 4.0), 1e-7)
        pose, links = moved, moved_links
        losses.append(value)
        if len(losses) > patience and losses[-1 - patience] - value < patience * tolerance * value:
            break
    return pose, losses


def _bounded_step(
    band: np.ndarray, gradient: np.ndarray, damping: float, limits: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """The damped Gauss-Newton step (T V,) that keeps the joints within their limits, by an active set."""
    damped = band.copy()
    damped[0] += damping * (band[0] + band[0].mean())
    low, high = (
        np.full((len(joints), 6 + joints.shape[1]), -np.inf),
        np.full((len(joints), 6 + joints.shape[1]), np.inf),
    )
    low[:, 6:], high[:, 6:] = limits[:, 0] - joints, limits[:, 1] - joints
    low, high = low.ravel(), high.ravel()
    held = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0))
    step = np.zeros_like(gradient)
    for _ in range(4):
        try:
            step = _solve_with(damped, -gradient, held, step)
        except np.linalg.LinAlgError:
            return np.zeros_like(gradient)
        outside = (step < low) | (step > high)
        if not outside.any():
            break
        held = held | outside
        step = np.clip(step, low, high)
    return np.clip(step, low, high)


def _solve_with(band: np.ndarray, right: np.ndarray, held: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Solve the banded system for the free variables while the held ones keep their values."""
    from scipy.linalg import solveh_banded

    if held.any():
        # few are held: their rows and columns leave the matrix, and what they pull at goes to the right
        j, k = np.flatnonzero(held), np.arange(1, len(band))[:, None]
        reduced, right = band.copy(), right.copy()
        for pull, other, inside in ((band[1:, j], j + k, j + k < len(held)), (band[k, j - k], j - k, j >= k)):
            np.subtract.at(right, other[inside], (pull * values[j])[inside])
        reduced[np.broadcast_to(k, (len(k), len(j)))[j >= k], (j - k)[j >= k]] = 0.0
        reduced[1:, j], reduced[0, j], right[j] = 0.0, 1.0, values[j]
        band = reduced
    return solveh_banded(band, right, lower=True, check_finite=False)


def move(pose: Pose, step: np.ndarray, limits: np.ndarray) -> Pose:
    """The configuration after a change (T, V)."""
    quat = rot.normalize(rot.multiply(rot.from_rotvec(step[:, 3:6]), pose.root_quat))
    return Pose(pose.root_pos + step[:, :3], quat, np.clip(pose.joints + step[:, 6:], limits[:, 0], limits[:, 1]))

"""Telling two kinds of rows apart: boosted stumps, judged on groups of rows that they have not seen.

Stumps are rules of one feature and one threshold, and add up. Boosting after
Friedman (Annals of Statistics 29, 2001) with Newton's steps on the logistic loss.
"""

from dataclasses import dataclass

import numpy as np

ROUNDS, SHRINKAGE, RIDGE = 120, 0.15, 1.0
THRESHOLDS = 15
"""Of each feature, evenly many rows between them."""
TURNS = 5
"""The features take turns, a fifth of them in a round: where few rows could be told by many, no single one decides."""


@dataclass(frozen=True)
class Stumps:
    """A sum of rules."""

    feature: np.ndarray
    """(R,) index of each rule's feature."""
    threshold: np.ndarray
    """(R,)"""
    low: np.ndarray
    """(R,) log odds that it adds where the feature is at most the threshold,"""
    high: np.ndarray
    """(R,) and elsewhere."""

    def score(self, rows: np.ndarray) -> np.ndarray:
        """Log odds (N,) of rows (N, F) to be of kind 1."""
        return np.where(rows[:, self.feature] <= self.threshold, self.low, self.high).sum(-1)


def fit_stumps(rows: np.ndarray, kind: np.ndarray) -> Stumps:
    """Learn to tell rows (N, F) of kind 1 from those of kind 0 (N,); both kinds weigh the same."""
    weight = np.where(kind == 1, 0.5 / max(kind.mean(), 1e-9), 0.5 / max((1 - kind).mean(), 1e-9))
    edges = np.quantile(rows, np.linspace(0, 1, THRESHOLDS + 2)[1:-1], axis=0)  # (E, F)
    below = (rows[:, None, :] <= edges).reshape(len(rows), -1).astype(np.float32)
    score, rules = np.zeros(len(rows)), []
    turn = np.tile(np.arange(rows.shape[1]) % TURNS, THRESHOLDS)
    for number in range(ROUNDS):
        chance = 1 / (1 + np.exp(-score))
        slope = (weight * (kind - chance)).astype(np.float32)
        curve = (weight * chance * (1 - chance)).astype(np.float32)
        left, left_curve = (np.stack([slope, curve]) @ below).astype(float)
        right, right_curve = float(slope.sum()) - left, float(curve.sum()) - left_curve
        gain = left**2 / (left_curve + RIDGE) + right**2 / (right_curve + RIDGE)
        best = int(np.argmax(np.where(turn == number % min(TURNS, rows.shape[1]), gain, -np.inf)))
        low = SHRINKAGE * left[best] / (left_curve[best] + RIDGE)
        high = SHRINKAGE * right[best] / (right_curve[best] + RIDGE)
        score += np.where(below[:, best] > 0, low, high)
        rules.append((best % rows.shape[1], edges.reshape(-1)[best], low, high))
    feature, threshold, lows, highs = (np.array(values) for values in zip(*rules, strict=True))
    return Stumps(feature.astype(int), threshold, lows, highs)


def area_under_curve(score: np.ndarray, kind: np.ndarray) -> float:
    """Chance that a row of kind 1 scores higher than one of kind 0; ties count half."""
    ordered, inverse, count = np.unique(score, return_inverse=True, return_counts=True)
    rank = (np.cumsum(count) - 0.5 * (count - 1))[inverse]
    ones = int(kind.sum())
    zeros = len(kind) - ones
    return float((rank[kind == 1].sum() - ones * (ones + 1) / 2) / (ones * zeros))


def unseen_area(rows: np.ndarray, kind: np.ndarray, group: np.ndarray, folds: int) -> float:
    """Area under the curve on rows of groups that the stumps were not fitted to: the mean over folds, in each of which
    every kind leaves out whole groups; NaN if a kind has a single group.
    """
    fold = np.zeros(len(rows), int)
    for value in (0, 1):
        groups, sizes = np.unique(group[kind == value], return_counts=True)
        folds = min(folds, len(groups))
    if folds < 2:
        return float("nan")
    for value in (0, 1):
        groups, sizes = np.unique(group[kind == value], return_counts=True)
        load = np.zeros(folds)
        for index in np.argsort(-sizes, kind="stable"):  # the largest first, each to the emptiest fold
            fold[(group == groups[index]) & (kind == value)] = np.argmin(load)
            load[np.argmin(load)] += sizes[index]
    areas = [
        area_under_curve(fit_stumps(rows[fold != i], kind[fold != i]).score(rows[fold == i]), kind[fold == i])
        for i in range(folds)
    ]
    return float(np.mean(areas))

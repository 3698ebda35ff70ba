"""Meshes that several tests import: a table and a chair of boxes, a sofa swept from a curved outline."""

import numpy as np
import trimesh


def box(x, y, z):
    low, high = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
    found = trimesh.creation.box(high - low)
    found.apply_translation((low + high) / 2)
    return found


def joined(parts):
    return trimesh.util.concatenate(parts)


def chair(seat=0.45, height=0.9):
    """Front to +x, z up, metres; seat 0.44 x 0.46 m at `seat`, its last 3 cm below the back."""
    legs = [box((x, x + 0.04), (y, y + 0.04), (0, seat - 0.04)) for x in (-0.22, 0.18) for y in (-0.23, 0.19)]
    back = [box((-0.22, -0.19), (-0.23, 0.23), (seat, height))] if height > seat else []
    return joined([box((-0.22, 0.22), (-0.23, 0.23), (seat - 0.04, seat)), *back, *legs])


def table():
    return joined(
        [
            box((-0.4, 0.4), (-0.6, 0.6), (0.80, 0.84)),
            *(box((x, x + 0.05), (y, y + 0.05), (0, 0.80)) for x in (-0.4, 0.35) for y in (-0.6, 0.55)),
        ]
    )


def swept(outline, width):
    """A solid whose section in x and z is `outline` (N, 2), counter-clockwise, swept over `width` along y."""
    n = len(outline)
    ends = [np.column_stack([outline[:, 0], np.full(n, y), outline[:, 1]]) for y in (-width / 2, width / 2)]
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.stack([i, i + n, j], -1), np.stack([j, i + n, j + n], -1)])
    cap = np.array(_ears(outline))
    return trimesh.Trimesh(np.concatenate(ends), np.concatenate([sides, cap, cap[:, ::-1] + n]), process=False)


def _ears(outline):
    left, found = list(range(len(outline))), []

    def turn(a, b, c):
        return np.cross(np.append(b - a, 0), np.append(c - a, 0))[2]

    while len(left) > 2:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            p, q, r = outline[[a, b, c]]
            inside = [
                turn(p, q, outline[m]) > 0 and turn(q, r, outline[m]) > 0 and turn(r, p, outline[m]) > 0
                for m in left
                if m not in (a, b, c)
            ]
            if turn(p, q, r) > 0 and not any(inside):
                found.append((a, b, c))
                left.pop(k)
                break
        else:
            left.pop(0)
    return found


def sofa_outline():
    """Counter-clockwise: a rounded cushion at 0.42 m, a back that leans and is round on top."""
    nose = [(0.36 + 0.06 * np.cos(a), 0.36 + 0.06 * np.sin(a)) for a in np.linspace(0, np.pi / 2, 7)]
    top = [(-0.32 + 0.07 * np.cos(a), 0.78 + 0.05 * np.sin(a)) for a in np.linspace(0.2, np.pi, 8)]
    return np.array(
        [(-0.42, 0.06), (0.42, 0.06), *nose, (0.1, 0.43), (-0.14, 0.42), (-0.20, 0.52), *top, (-0.43, 0.45)]
    )


def sofa(width=1.6):
    """Front to +x, z up, metres: one concave body with a curved seat between two rounded arms, on four feet."""
    arm = np.array(
        [
            (-0.40, 0.06),
            (0.40, 0.06),
            *((0.32 + 0.08 * np.cos(a), 0.52 + 0.08 * np.sin(a)) for a in np.linspace(0, np.pi / 2, 6)),
            (-0.40, 0.62),
        ]
    )
    arms = [swept(arm, 0.16) for _ in range(2)]
    for part, side in zip(arms, (-1, 1), strict=True):
        part.apply_translation([0, side * (width / 2 + 0.06), 0])
    feet = [
        box((x, x + 0.06), (y - 0.03, y + 0.03), (0, 0.07))
        for x in (-0.38, 0.32)
        for y in (-width / 2 + 0.1, width / 2 - 0.1)
    ]
    return joined([swept(sofa_outline(), width), *arms, *feet])


def y_up(mesh):
    """The same with y up and -z to the front, as ShapeNet has it."""
    turned = mesh.copy()
    turned.vertices = np.column_stack([mesh.vertices[:, 1], mesh.vertices[:, 2], mesh.vertices[:, 0]])
    turned.vertices[:, 2] *= -1
    turned.vertices[:, 0] *= -1
    return turned

"""How scenes are drawn: faces that share a plane, and the edges of shadows."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.drawing.camera import Camera, Picture
from mimicbench.drawing.opengl import NoPictures
from mimicbench.report.render import Painter
from mimicbench.sim.scene import build_model
from stool import H1, block

ASIDE = Camera((0.0, 0.0, 0.25), 2.5, 180.0 - 37.0)
FAR_AWAY = np.array([80.0, 80.0, 1.0, 1, 0, 0, 0, *H1.rest_pose])
"""The robot, where nobody sees it."""


def drawn(obj, picture, camera=ASIDE):
    try:
        with Painter(build_model(H1, obj, visuals=True), picture, camera) as painter:
            return painter.draw(FAR_AWAY).astype(int)
    except NoPictures as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("elevation", [-13.0, -31.0])
def test_of_faces_in_one_plane_the_later_is_seen(elevation):
    """A green box through the middle of a red one, as deep and as high: from the front all of it is seen."""
    both = replace(
        block(),
        box_pos=np.array([[0, 0, 0.21], [0, 0.007, 0.21]]),
        box_quat=np.tile(rot.IDENTITY, (2, 1)),
        box_half=np.array([[0.25, 0.25, 0.21], [0.25, 0.12, 0.21]]),
        box_rgb=np.array([[0.9, 0.0, 0.0], [0.0, 0.9, 0.0]]),
    )
    alone = replace(both, **{name: getattr(both, name)[1:] for name in ("box_pos", "box_quat", "box_half", "box_rgb")})
    camera, picture = replace(ASIDE, azimuth=180.0, elevation=elevation), Picture(320, 240, shadow=0, samples=0)
    green, expected = (
        (found[..., 1] > found[..., 0] + 40) for found in (drawn(both, picture, camera), drawn(alone, picture, camera))
    )
    assert expected.sum() > 1000
    assert (green != expected).sum() < 0.01 * expected.sum()


def test_several_suns_make_soft_shadows():
    def between(suns):
        found = drawn(block(), Picture(200, 140, 1024, samples=0, suns=suns)).mean(-1)
        bare = drawn(block(), Picture(200, 140, 0, samples=0)).mean(-1)
        darker = bare - found
        return ((darker > 0.2 * darker.max()) & (darker < 0.8 * darker.max())).sum(), (darker > 5).sum()

    (hard, _), (soft, shaded) = between(1), between(16)
    assert soft > 3 * hard + 30 and shaded > 100

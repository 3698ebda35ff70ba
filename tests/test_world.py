"""The whole world: any object of any family, in any company."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mujoco.batch import Batch

from mimicbench.bench.soak import PAPER_COUNTS
from mimicbench.objects.registry import FAMILIES
from mimicbench.sensors.elevation import camera_map
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS
from stool import H1, place, standing

BATCHES = {
    movable: Batch(build_model(H1, FAMILIES.get(family).make(0, 0)), 1, 1)
    for movable, family in ((False, "chair"), (True, "box"))
}


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(list(FAMILIES)), st.floats(0, 1, exclude_max=True), st.integers(0, 3))
def test_every_object_compiles_and_shares_a_batch(family, place, seed):
    obj = FAMILIES.get(family).make(int(place * PAPER_COUNTS[family]), seed)
    assert obj.movable == (family == "box")
    BATCHES[obj.movable].set_models(build_model(H1, obj))  # raises if it does not fit
    BATCHES[obj.movable].reset(stage=0)
    BATCHES[obj.movable].step(nstep=4)
    assert np.isfinite(BATCHES[obj.movable].qpos).all() and not BATCHES[obj.movable].warning[..., 1].any()


def test_maps_of_many_robots_are_those_of_each_alone():
    physics = NativePhysics(H1, [FAMILIES.get("chair").make(i, 0) for i in range(70)], workers=2)
    pos, joints = standing()
    place(physics, pos, joints)
    for task in ("sit-chair", "touch-points"):
        rig, cell = TASKS.get(task).rig, TASKS.get(task).map_cell
        together = camera_map(physics, None, 30, 40, rig, cell).numpy()
        for env in (0, 33, 69):
            np.testing.assert_array_equal(
                together[env], camera_map(physics, np.array([env]), 30, 40, rig, cell)[0].numpy()
            )

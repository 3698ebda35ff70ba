"""An episode that succeeded, for tests that change what they are about (dataclasses.replace)."""

from mimicbench.evaluate.rows import EpisodeRow

EPISODE = EpisodeRow(
    task="sit-chair",
    stage="imitate",
    policy="bc",
    preset="improved",
    robot="h1",
    seed=0,
    episode=0,
    object_id="chair-0-00001",
    object_kind="dining",
    split="test",
    reference_id="sit-chair-0-00001",
    steps=1000,
    success=True,
    success_at_end=True,
    stays=True,
    first_success_time=5.5,
    fell=False,
    fell_time=None,
    fell_phase="",
    diverged=False,
    max_energy=5e4,
    seat_height=0.45,
    start_distance=2.5,
    end_distance=0.0,
    mimicbench="0.1.0",
    mujoco="3.17.0",
)

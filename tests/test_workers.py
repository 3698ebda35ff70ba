"""The same seed gives the same numbers, whatever the number of workers: clips, retargeting, tracking and policies,
with the shipped checkpoints.
"""

import pytest

import making
from mimicbench.benchmark.finding import stages_of
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.judging import batches_judged, episodes_of
from mimicbench.benchmark.who import who_of
from mimicbench.core.run import RunContext
from mimicbench.evaluate.rollout import Protocol


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    made = []
    for workers in (1, 2):
        workdir = tmp_path_factory.mktemp(f"workers{workers}")
        made.append(start(making.small(objects=24, seed=3), workdir, RunContext(workers, quiet=True)))
        episodes_of(made[-1], 4)
    return made


def test_the_same_clips(runs):
    for name in ("references", "retarget"):
        stages = [stages_of(run.workdir, "sit-chair", name) for run in runs]
        one, two = ({path.name: path.read_bytes() for path in found[0].folder.glob("*.npz")} for found in stages)
        assert one == two and len(one) >= 4 and len(stages[0]) == len(stages[1]) == 1


def judged(run, name, count):
    """Rows of every batch."""
    batches = batches_judged(run, who_of(run, name), episodes_of(run, count).set, Protocol())
    return [row for rows, _ in batches for row in rows]


def test_the_same_tracking(runs):
    one, two = (judged(run, "tracker", 4) for run in runs)
    assert one == two and len(one) == 4


def test_the_same_episodes_of_the_best_policy(runs):
    one, two = (judged(run, "best", 2) for run in runs)
    assert one == two and len(one) == 2

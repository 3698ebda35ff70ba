"""The same seed gives the same numbers, whatever the number of workers: clips, retargeting, tracking and policies,
with the shipped checkpoints.
"""

from dataclasses import replace

import pytest

from mimicbench.workspace import Workspace, evaluate_policy, evaluate_tracker, prepare_episodes, tracker_folder


@pytest.fixture(scope="module")
def workspaces(tmp_path_factory):
    made = []
    for workers in (1, 2):
        ws = Workspace(tmp_path_factory.mktemp(f"workers{workers}"), "sit-chair", seed=3, workers=workers, quiet=True)
        prepare_episodes(ws, 4)
        made.append(ws)
    return made


def test_the_same_clips(workspaces):
    for stage in ("references", "retarget"):
        one, two = ({path.name: path.read_bytes() for path in ws.folder(stage).glob("*.npz")} for ws in workspaces)
        assert one == two and len(one) >= 4


def test_the_same_tracking(workspaces):
    one, two = (evaluate_tracker(ws, tracker_folder(ws), 4, None) for ws in workspaces)
    assert one == two


def test_the_same_episodes_of_the_best_policy(workspaces):
    one, two = (evaluate_policy(ws, "best", 4)[0] for ws in workspaces)
    assert one == two
    again = evaluate_policy(replace(workspaces[0], workers=2), "best", 4)[0]
    assert again == one

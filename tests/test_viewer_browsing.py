"""What the page opens, and that nothing is left of what is no longer listed. No browser looks."""

import shutil
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

for name in ("viser", "mjviser", "websockets"):
    pytest.importorskip(name, reason=f"{name} is not installed: pip install 'mimicbench[view]'")

from episodes import EPISODE  # noqa: E402
from making import make, small  # noqa: E402
from mimicbench.benchmark.shipped import SHIPPED  # noqa: E402
from mimicbench.benchmark.who import Who  # noqa: E402
from mimicbench.core.errors import MimicbenchError  # noqa: E402
from mimicbench.core.files import read_record, write_record  # noqa: E402
from mimicbench.core.motion import RobotMotion  # noqa: E402
from mimicbench.evaluate.rows import write_rows  # noqa: E402
from mimicbench.viewer.catalog import Catalog  # noqa: E402
from mimicbench.viewer.page import Page, ViewConfig  # noqa: E402
from mimicbench.viewer.showing import told_power  # noqa: E402

TASK = "sit-chair"
BC = SHIPPED / TASK / "bc"


@pytest.fixture(scope="module")
def workdir(tmp_path_factory):
    """Two clips, and episodes that began in the first: `a` did not fail, `b` and `c` did, `c` is of a known policy."""
    folder = tmp_path_factory.mktemp("work")
    make("retarget", folder, small(clips=2))
    (clips,) = Catalog(folder).sets(TASK, "retarget")
    motion = RobotMotion.load(clips.file(clips.items[0]))
    done = replace(EPISODE, object_id=motion.object_id, reference_id=motion.id)
    fell = replace(done, success=False, stays=False, fell=True, fell_time=3.0, fell_phase="walking")
    evaluate = folder / TASK / "evaluate"
    write_rows(evaluate / "a-done.parquet", [done], {})
    write_rows(evaluate / "b-fell.parquet", [done, replace(fell, episode=1)], {})
    write_rows(evaluate / "c-bc.parquet", [fell], Who("bc", BC).digests)
    (evaluate / "b-cut.parquet").write_bytes((evaluate / "a-done.parquet").read_bytes()[:100])
    return folder


@contextmanager
def page(workdir, **settings):
    """A page that is closed again."""
    found = Page(ViewConfig(workdir, 18160, **settings))
    try:
        yield found
    finally:
        found.close()


def test_failed_episodes_are_found_in_whichever_set_they_are(workdir):
    with page(workdir, failed=True) as found:
        assert found.browse.set.value == "b-fell"
        assert found.session.opened.name == f"{TASK}-0-00001 bc: fell while walking"
    with page(workdir, failed=True, policy=(str(BC),)) as found:
        assert found.browse.set.value == "c-bc", "whoever is named comes first"
        found.browse.kind.value = "retargeted clips"
        assert found.session.opened.policy is None and found.browse.outcome.value == "any", "no clip has failed"


def test_what_is_not_found_is_not_in_the_scene(workdir):
    with page(workdir, kind="retarget") as found:
        opened, found.act.who["robot"].value = found.session.opened, "bc"
        found.act.begin()
        assert found.session.actors and found.act.episodes and found.play.playing
        found.browse.words.value = "no such clip"
        assert found.browse.facts.content == "*nothing has 'no such clip' in its name*"
        assert found.session.opened is None and not found.session.actors and not found.act.episodes
        assert not found.play.playing and found.session.duration == 0.0
        with pytest.raises(MimicbenchError, match="choose an item first"):
            found.act.begin()
        found.browse.words.value = ""
        assert found.session.opened.name == opened.name and found.act.who["robot"].value == "bc", "as it was"


def test_policies_of_files_act(workdir, tmp_path):
    from test_onnx import made
    from test_policies import written

    files = made(tmp_path / "network.onnx"), written(tmp_path / "program.py")
    with page(workdir, kind="retarget", policy=tuple(map(str, files))) as found:
        for role, name in (("robot", "network"), ("other", "program")):
            found.act.who[role].value = name
        found.act.begin()
        for episode in found.act.episodes.values():
            episode.until(0.1)
            assert not episode.error and not episode.follows and len(episode.track) == 6


def test_curves_tell_of_the_steps_that_are_over(workdir):
    """Of who acts, a step is told of at its end: none in the first frame."""
    with page(workdir, kind="retarget") as found:
        found.act.who["robot"].value = "bc"
        found.act.begin()
        found.play.play(False)
        found.act.episodes["robot"].until(1.0)
        curves = found.act.episodes["robot"].track.curves()
        for step in (0, 1, 5, 50):
            found.session.show(step * 0.02)
            times, dots = found.plot.effort.data[0], found.plot.effort.data[-1]
            assert times[np.isfinite(dots)].tolist() == pytest.approx([step * 0.02] if step else [])
            assert told_power(curves.effort[:step].max(initial=0.0)) in found.show.words.content


def test_what_cannot_be_shown_keeps_nobody_from_the_rest(workdir, tmp_path):
    """A damaged clip comes first, whose name is what a browser would run; the next one is opened, and people beside
    whom an earlier set has lost its own.
    """
    for kind in ("objects", "references", "retarget"):
        shutil.copytree(workdir / TASK / kind, tmp_path / TASK / kind)
    (made,) = Catalog(tmp_path).sets(TASK, "retarget")
    stage = made.path
    (stage / "<b onload='x'>.npz").write_bytes(b"PK")
    lost = stage.parent / "a-lost"
    shutil.copytree(stage, lost)
    header = read_record(lost / "header.json")
    write_record(
        lost / "header.json", {**header, "reads": {**header["reads"], "references": "references/gone-11111111"}}
    )
    with page(tmp_path, kind="retarget") as found:
        found.browse.set.value = made.name
        assert found.browse.item.value == "<b onload='x'>" and found.session.opened is None
        shown = found.browse.facts.content
        assert "cannot be shown" in shown and "<" not in shown.replace("\\<", "")
        found.browse.item.value = next(name for name in made.items if name.startswith(TASK))
        assert found.session.opened is not None
        found.browse.kind.value = "human references"
        assert set(found.session.actors) == {"human", "retargeted"}


def test_nothing_failed(workdir):
    with page(workdir, failed=True, find="no such episode") as found:
        assert found.session.opened is None and not found.session.actors

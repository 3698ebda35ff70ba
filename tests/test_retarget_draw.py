"""`mimicbench retarget draw`: robot clips below the people that they were made of."""

from pathlib import Path

import imageio.v3 as iio
import pytest

from making import make, small
from mimicbench.benchmark.finding import read_by
from mimicbench.commands.retarget import BETWEEN_CLIPS, draw
from mimicbench.core.errors import BadFile, MimicbenchError


def test_clips_are_drawn_below_their_people(tmp_path, capsys, monkeypatch):
    stage = make("retarget", tmp_path, small(clips=2))
    names = sorted(path.stem for path in stage.folder.glob("*.npz"))
    draw(tmp_path / "one.png", (f"{names[1]}.npz",), workdir=tmp_path, workers=1)
    draw(tmp_path / "all.png", workdir=tmp_path, workers=1)
    one, both = (iio.imread(tmp_path / name) for name in ("one.png", "all.png"))
    assert both.shape == (2 * len(one) + BETWEEN_CLIPS, *one.shape[1:]) and (both[-len(one) :] == one).all()
    assert (both[len(one) : -len(one)] == 255).all()
    told = capsys.readouterr().out
    assert told.count(names[1]) == 2 and told.count(names[0]) == 1 and "from the top the human, h1, kept" in told
    # a stage that is named brings its people and objects along, wherever one is
    monkeypatch.chdir(stage.folder)
    draw(tmp_path / "named.png", (names[1],), stage=Path(), workers=1)
    assert (iio.imread(tmp_path / "named.png") == one).all()
    with pytest.raises(BadFile, match=r"is a stage 'retarget', made from no demos; give another --stage"):
        read_by(stage, "demos")


def test_what_is_not_there_is_told(tmp_path):
    with pytest.raises(BadFile, match="run `mimicbench retarget --task sit-chair"):
        draw(tmp_path / "one.png", workdir=tmp_path)
    with pytest.raises(MimicbenchError, match="sit-lamp"):
        draw(tmp_path / "one.png", task="sit-lamp", workdir=tmp_path)
    assert not list(tmp_path.iterdir())

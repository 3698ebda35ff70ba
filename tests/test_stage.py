"""Stages: what determines one, how much of it there is, who holds it, and that a refused call leaves nothing behind."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError
from mimicbench.core.files import write_record
from mimicbench.core.stage import _WORDS, HEADER, StageKey, locked, opened, read_stage


def key(**changes):
    values = {
        "stage": "objects",
        "task": "sit-chair",
        "seed": 0,
        "settings": {"sizes": (1, 2)},
        "made_from": {"shapes": "0"},
        "amounts": {"count": 3},
        "words": ("chair",),
    }
    return StageKey(**{**values, **changes})


def test_a_stage_is_unfinished_until_it_is_finished(tmp_path):
    folder = key().folder(tmp_path)
    assert folder.parent == tmp_path / "sit-chair" / "objects" and folder.name == f"chair-{key().digest}"
    with pytest.raises(BadFile, match="holds no stage"):
        read_stage(folder)
    with opened(folder, key(), {"task": "sit-chair"}) as stage:
        assert not stage.complete
        with pytest.raises(BadFile, match="unfinished"):
            read_stage(folder)
        finished = stage.finish(made=3)
    assert finished.complete and finished.fingerprint == stage.fingerprint == key().fingerprint
    assert finished.digest == key().digest
    with opened(folder, key()) as again:
        assert again.complete and again.summary == {"made": 3}
    assert read_stage(folder).header["recipe"] == {"task": "sit-chair"}


def test_an_item_that_is_gone_is_made_again(tmp_path):
    folder = key().folder(tmp_path)
    with opened(folder, key()) as stage:
        for name in "abc":
            (folder / f"{name}.npz").write_bytes(b"")
        stage.finish(made=3)
    assert read_stage(folder).complete
    (folder / "d.npz").write_bytes(b"")  # one more does no harm
    assert read_stage(folder).complete
    (folder / "b.npz").unlink()
    (folder / "d.npz").unlink()
    with pytest.raises(BadFile, match="lacks 1 of its 3 files"):
        read_stage(folder)
    assert read_stage(folder, whole=False).summary == {"made": 3}, "to be told of, all of it is not needed"
    with opened(folder, key()) as again:
        assert not again.complete
        (folder / "b.npz").write_bytes(b"")
        again.finish(made=3)
    assert read_stage(folder).summary == {"made": 3}


@pytest.mark.parametrize(
    "change", [{"settings": {"sizes": [1, 3]}}, {"seed": 1}, {"task": "lie-bed"}, {"made_from": {"shapes": "1"}}]
)
def test_what_determines_a_stage_gives_it_a_folder_of_its_own(tmp_path, change):
    other = key(**change)
    assert other.folder(tmp_path) != key().folder(tmp_path) and other.fingerprint != key().fingerprint
    with opened(tmp_path / "x", key()):
        pass
    content = (tmp_path / "x" / HEADER).read_bytes()
    with (
        pytest.raises(MimicbenchError, match=f"made with other {_WORDS[next(iter(change))]}"),
        opened(tmp_path / "x", other),
    ):
        pass
    assert (tmp_path / "x" / HEADER).read_bytes() == content
    # x is a name that somebody gave, and can give anew; what is called by its digest has none
    with (
        pytest.raises(MimicbenchError, match=r"give another name \(--to\), use another"),
        opened(tmp_path / "x", other),
    ):
        pass
    named_by_digest = other.folder(tmp_path)
    named_by_digest.mkdir(parents=True)
    (named_by_digest / HEADER).write_bytes(content)
    with (
        pytest.raises(MimicbenchError, match=f"{_WORDS[next(iter(change))]}; use another"),
        opened(named_by_digest, other),
    ):
        pass


def test_words_and_amounts_determine_nothing_but_later_stages_see_the_amount():
    assert key(words=("other",)).digest == key().digest == key(amounts={"count": 9}).digest
    assert key(amounts={"count": 9}).fingerprint != key().fingerprint


def test_an_amount_that_is_raised_goes_on_and_a_smaller_one_is_a_part_of_it(tmp_path):
    folder = tmp_path / "x"
    with opened(folder, key()) as stage:
        stage.finish(made=3)
    with opened(folder, key(amounts={"count": 5})) as more:
        assert not more.complete and not more.ahead
        more = more.finish(made=5)
    assert read_stage(folder).summary == {"made": 5}
    with opened(folder, key(amounts={"count": 2})) as less:
        assert not less.complete and less.ahead, "its summary is another, so it is counted again"
        less = less.finish(made=2)
    assert less.complete and less.summary == {"made": 2} and less.fingerprint == key(amounts={"count": 2}).fingerprint
    assert read_stage(folder).header == more.header, "and the folder stays what it is"


def test_less_of_what_was_stopped_on_its_way_to_more_is_finished(tmp_path):
    folder = tmp_path / "x"
    with opened(folder, key(amounts={"count": 5})):
        pass  # stopped
    with opened(folder, key()) as less:
        assert not less.complete and not less.ahead
        less.finish(made=3)
    assert read_stage(folder).summary == {"made": 3} and read_stage(folder).fingerprint == key().fingerprint
    with opened(folder, key(amounts={"count": 5})) as more:
        assert not more.complete and not more.ahead


def test_a_training_cannot_be_had_smaller_and_one_that_was_raised_is_another(tmp_path):
    folder = tmp_path / "x"
    with opened(folder, key(amounts={"samples": 10}), trained=True) as stage:
        stage.finish()
    fewer = opened(folder, key(amounts={"samples": 5}), trained=True)
    begun = {"folder": tmp_path / "begun", "trained": True}
    with opened(key=key(amounts={"samples": 10}), **begun):
        pass
    less = opened(key=key(amounts={"samples": 5}), **begun)
    with pytest.raises(MimicbenchError, match=r"begun for 10 samples and is unfinished; ask for as much"), less:
        pass
    with pytest.raises(MimicbenchError, match=r"for 10 samples, more than the 5 samples"), fewer:
        pass
    with opened(folder, key(amounts={"samples": 20}), trained=True) as more:
        assert more.header["raised_from"] == [{"samples": 10}]
        assert more.finish().fingerprint != key(amounts={"samples": 20}).fingerprint


def test_a_refused_call_leaves_nothing_behind(tmp_path):
    folder = key().folder(tmp_path / "new")
    with pytest.raises(BadMotion), opened(folder, key()):
        raise BadMotion("nothing came of it")
    assert not (tmp_path / "new").exists()
    with pytest.raises(BadMotion), opened(folder, key()) as stage:
        (stage.folder / "item.json").write_text("{}")
        raise BadMotion("the second one failed")
    assert (folder / "item.json").exists() and not json.loads((folder / HEADER).read_text())["complete"]


def test_two_programs_in_one_folder(tmp_path):
    script = f"""
import sys
from pathlib import Path
from mimicbench.core.stage import locked
with locked(Path({str(tmp_path)!r})):
    print("held", flush=True)
    sys.stdin.readline()
"""
    child = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdin is not None and child.stdout is not None
    assert child.stdout.readline() == "held\n"
    leftover = tmp_path / f".clip.npz.{child.pid}.tmp"
    leftover.touch()
    with pytest.raises(MimicbenchError, match="another program is working in"), opened(tmp_path, key()):
        pass
    assert leftover.exists(), "nobody deletes a live one's temporary file"
    child.kill()
    child.wait()
    with opened(tmp_path, key()) as stage:
        assert not leftover.exists()
        stage.finish()
    with locked(tmp_path), opened(tmp_path, key()) as stage:
        assert stage.complete, "what is finished can be read by all"


@pytest.mark.parametrize("content", ["", "{", "[]", "3", '{"complete": true}'])
def test_damaged_header(tmp_path: Path, content: str):
    (tmp_path / HEADER).write_text(content)
    with pytest.raises(MimicbenchError), opened(tmp_path, key()):
        pass
    with pytest.raises(MimicbenchError):
        read_stage(tmp_path)


def test_names_of_folders_do_not_drift(tmp_path):
    """Of a release, too: what is in a workdir would be made again."""
    assert key().digest == key(settings=dict(reversed({"sizes": (1, 2)}.items()))).digest
    two, turned = {"a": 1, "b": 2}, {"b": 2, "a": 1}
    assert key(settings=two).digest == key(settings=turned).digest and len(key().digest) == 8
    assert (key().digest, key().fingerprint) == ("a801caa5", "1a2efb4301c01dda"), "new only if SCHEMA was raised"
    reads = {"objects": tmp_path / "work" / "sit-chair" / "objects" / "chair-0"}
    with opened(tmp_path / "x", key(reads=reads)) as stage:
        assert stage.header["reads"] == {"objects": "objects/chair-0"}


def test_what_another_schema_made_is_refused(tmp_path):
    """A release that makes other items of the same key raises the schema, and does not go on with older ones."""
    with opened(tmp_path / "x", key()) as stage:
        older = {**stage.header, "schema": stage.header["schema"] - 1}
    write_record(tmp_path / "x" / HEADER, older)
    with pytest.raises(MimicbenchError, match="made with other versions of its format"), opened(tmp_path / "x", key()):
        pass


def test_of_several_amounts_each_counts(tmp_path):
    folder = tmp_path / "x"
    with opened(folder, key(amounts={"count": 3, "more": 5})) as stage:
        stage.finish()
    with opened(folder, key(amounts={"count": 3, "more": 4})) as less:
        assert less.ahead, "one is the same, the other less"
    with opened(folder, key(amounts={"count": 3, "more": 5, "new": 1})) as other:
        assert not other.ahead and not other.complete

"""Pictures of the documents: every one is drawn by the command, and shows what the program makes today."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
DATA = ROOT.parent / "shared" / "data"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
DRAW = "python scripts/draw_docs.py --real shared/data"


@pytest.fixture(scope="module")
def draw():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        import draw_docs

        yield draw_docs


def test_fingerprints_tell_changes_from_rounding(draw):
    from doc_pictures.picture import fingerprint, same

    pose = np.random.default_rng(0).normal(size=(300, 22, 3))
    known = fingerprint([pose, np.ones(3)])
    assert same(fingerprint([pose + 1e-9, np.ones(3)]), json.loads(json.dumps(known)))
    assert not same(fingerprint([pose * 1.01, np.ones(3)]), known)
    assert not same(fingerprint([pose, np.array([1.0, 1.0, 1.02])]), known)
    assert not same(fingerprint([pose]), known) and not same(fingerprint([pose[:-1], np.ones(3)]), known)
    assert not same(known, None)


def test_every_picture_of_the_documents_is_drawn_by_the_command(draw):
    shown = {
        name
        for page in PAGES
        for name in re.findall(r"images/([\w-]+\.(?:png|jpg))\)", page.read_text(encoding="utf8"))
    }
    names = [picture.name for picture in draw.catalog(DATA)]
    assert len(names) == len(set(names))
    assert shown == set(names) == set(draw.manifest()) == {path.name for path in IMAGES.iterdir()} - {"manifest.json"}


def test_no_picture_is_stale(draw):
    from doc_pictures.picture import fingerprint, same

    known = draw.manifest()
    stale = [
        picture.name
        for picture in draw.catalog(DATA if DATA.is_dir() else None)
        if not same(fingerprint(picture.arrays(picture.make())), known.get(picture.name))
    ]
    assert not stale, f"{', '.join(stale)} show what is no longer so; run `{DRAW}` and look at them"

"""The tables, plots and page follow from the rows; the page needs nothing from outside.

Pictures and videos are what they say.
"""

import base64
import csv
import hashlib
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from episodes import EPISODE
from making import by_hand, small
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import copy_checkpoint
from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError
from mimicbench.core.files import remove_unfinished
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.drawing.camera import FIELD_OF_VIEW, Camera, Picture, frame_all
from mimicbench.drawing.opengl import NoPictures
from mimicbench.evaluate.failures import FAILURES
from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import read_rows
from mimicbench.objects.registry import FAMILIES, make_object
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.references.body.skeletons import SKELETONS, UNIHSI
from mimicbench.report import grouping, page, plots
from mimicbench.report.curves import read_curve
from mimicbench.report.paper_tables import TABLES as PAPER_TABLES
from mimicbench.report.paper_tables import TASKS, methods
from mimicbench.report.person import EYES, HAIR, SHIRT, SHOES, SKIN, SOLES, TROUSERS, place, solids_of
from mimicbench.report.pictures.gallery import Failed, counted, draw_failures, draw_objects
from mimicbench.report.pictures.sheet import CELL, contact_sheet, sheet_camera
from mimicbench.report.pictures.showcase import Clip, Recording, Showcase, ShowConfig, draw, moments, positions
from mimicbench.report.provenance import Provenance, package_versions, this_machine, without_folders
from mimicbench.report.render import (
    Painter,
    human_frames,
    robot_frames,
    with_object,
)
from mimicbench.report.sections import _judging_html
from mimicbench.report.stage import _curves
from mimicbench.report.table import Reported, Table, text, to_csv, to_latex, to_markdown, to_terminal
from mimicbench.report.tables.beside_paper import beside_paper_table, counterpart
from mimicbench.report.tables.best import best_policy
from mimicbench.report.tables.registry import TABLES
from mimicbench.report.tables.spec import Episodes, TableSpec
from mimicbench.report.video import strip, write_video
from mimicbench.report.write import ReportInputs, draw_plots, write_report
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.tasks import registry as tasks

SMALL = Picture(96, 64, shadow=0, samples=0)
CAMERA = Camera((0.5, 0.0, 0.8), 4.0, 128.0)
ROBOT = ROBOTS.get("h1")
CHAIR = make_object("chair-0-00003")


def made_up_rows():
    """Rows of two policies and a tracker: only for these tests."""
    row = replace(EPISODE, policy="act", seed=7, reference_id="ref", steps=300, start_distance=1.5)
    rows = []
    for stage, policy, successes in (("imitate", "act", 15), ("imitate", "bc<script>", 6), ("track", "hst", 18)):
        for i in range(20):
            ok = i < successes
            rows.append(
                replace(
                    row,
                    stage=stage,
                    policy=policy,
                    episode=i,
                    success=ok,
                    success_at_end=ok,
                    stays=ok,
                    first_success_time=5.5 if ok else None,
                    fell=i % 3 == 0 and not ok,
                    fell_time=4.0 if i % 3 == 0 and not ok else None,
                    fell_phase="walking" if i % 3 == 0 and not ok else "",
                    object_kind=("dining", "stool")[i % 2],
                    seat_height=0.38 + 0.01 * i,
                    start_distance=1 + 0.05 * i,
                    end_distance=0.0 if ok or i % 2 else 1.0,
                )
            )
    return tuple(rows)


INPUTS = ReportInputs(
    "sit-chair", made_up_rows(), Provenance(7, ("make run",), {"clips": 256}, {}, package_versions(), this_machine())
)
JUDGED = Episodes(INPUTS.rows)


def painter_or_skip(model):
    try:
        return Painter(model, SMALL, CAMERA)
    except NoPictures as error:
        pytest.skip(f"no pictures here: {error}")


@pytest.fixture(scope="module")
def model():
    return build_model(ROBOT, CHAIR, visuals=True)


# --- tables


def test_paper_means_are_the_means_of_the_tasks():
    for table in PAPER_TABLES:
        for method, mean in table.mean.items():
            rates = table.rates[method].values()
            assert len(rates) == 6
            assert np.mean([r.kinematic for r in rates]) == pytest.approx(mean.kinematic, abs=0.7), (
                table.caption,
                method,
            )
            assert np.mean([r.energy for r in rates]) == pytest.approx(mean.energy, abs=0.7), (table.caption, method)


def test_paper_rates_for_sitting_on_a_chair():
    pairs = {
        name: (rate.kinematic, rate.energy)
        for measures in ("tracking", "imitation")
        for name, rate in methods("sit-chair", measures).items()
    }
    assert pairs == {
        "Improved HST": (92, 70),
        "Simplified PHC": (87, 65),
        "Original HST": (0, 0),
        "ACT": (81, 69),
        "OmniH2O": (79, 72),
        "PPO": (50, 25),
        "HIT": (36, 28),
        "HumanPlus": (36, 28),
    }


def test_paper_tables_agree_with_its_source():
    source = Path(__file__).parents[1].parent / "shared" / "paper" / "mimicking-bench.tex"
    if not source.exists():
        pytest.skip("the paper's source is not here")
    tex = re.sub(r"(?<!\\)%.*|\\textbf|\\textcolor\{red\}|[{}]", "", source.read_text())
    printed = {tuple(re.findall(r"\d+/\d+", line)) for line in tex.split(r"\\")}
    for table in PAPER_TABLES:
        both_halves = [
            tuple(
                f"{r.kinematic}/{r.energy}"
                for r in (*table.rates[m].values(), *([table.mean[m]] if table.mean else []))
            )
            for m in table.rates
        ]
        for row in both_halves:
            assert any(line[: len(row)] == row or line[-len(row) :] == row for line in printed), (table.caption, row)


def test_every_paper_table_can_be_written():
    made = TABLES.get("paper").of(Episodes(()))
    assert [len(table.rows) for table in made] == [len(table.rates) for table in PAPER_TABLES]
    assert len({table.name for table in made}) == len(made)
    assert list(TASKS.values()) == ["SC", "SS", "LB", "LS", "T", "L"]


TABLE = Table(
    "t",
    "A_title",
    ("Name", "K", "Paper", "n"),
    (("a|b", Rate(3, 4), Reported(81), 2), ("c", None, None, 0.5)),
    note="50 % & more",
)


def test_writers_by_hand():
    assert to_markdown(TABLE).splitlines() == [
        "**A_title**",
        "",
        "| Name |                        K | Paper |   n |",
        "|------|-------------------------:|------:|----:|",
        "| a\\|b | 75.0 % [30.1–95.4] (3/4) |  81 % |   2 |",
        "| c    |                        - |     - | 0.5 |",
        "",
        "50 % & more",
    ]
    rows = list(csv.reader(io.StringIO(to_csv(TABLE))))
    assert rows[0] == ["Name", "K rate", "K low", "K high", "K successes", "K episodes", "Paper", "n"]
    assert [rows[1][i] for i in (0, 1, 4, 5, 6, 7)] == ["a|b", "0.75", "3", "4", "0.81", "2"]
    assert rows[2] == ["c", "", "", "", "", "", "", "0.5"]
    latex = to_latex(TABLE)
    assert r"a|b & 75.0 \% [30.1--95.4] (3/4) & 81 \% & 2 \\" in latex
    assert r"\begin{tabular}{lrrr}" in latex and r"A\_title. 50 \% \& more" in latex
    assert "75.0 % [30.1–95.4] (3/4)" in to_terminal(TABLE)
    with pytest.raises(MimicbenchError, match="1 cells under 2 columns"):
        Table("t", "", ("a", "b"), (("x",),))


@pytest.mark.parametrize("width", [200, 100, 80, 50, 30])
def test_terminals_break_no_words(width: int):
    found = JUDGED.summaries
    table = beside_paper_table("sit-chair", [replace(one, policy="act-clock") for one in found])
    shown = to_terminal(table, width)
    cells = {word for row in table.rows for cell in row for word in text(cell).split()}
    words = {word for word in shown.replace("│", " ").replace("┃", " ").split() if word[0] not in "─━┌└├┏┡"}
    assert cells <= words
    assert max(map(len, shown.splitlines())) <= max(width, 45)
    assert ("┏" in shown) == (width >= 80), "narrow terminals get a block of lines for each row"


def test_names_are_text_in_markdown_and_in_plots():
    """Not HTML, not formulas, not lines of their own."""
    rows = to_markdown(Table("t", "", ("<i>n",), (("<script>a\nb",),))).splitlines()
    assert [row.strip("| ") for row in rows if "n" in row or "b" in row] == ["&lt;i>n", "&lt;script>a b"]
    name = "a$^$b"
    shown = plots.rates_plot("one", {"K": [(name, plots.Mark(Rate(3, 4)))]})
    assert name in shown


def test_what_is_markup_elsewhere_is_text_on_the_terminal():
    table = Table("t", "[y] of", ("[bold]n",), (("[red]a [/] b and more",),), note="needs [train] in /x[/y]")
    shown = to_terminal(table)
    assert all(words in shown for words in ("[y] of", "[bold]n", "[red]a [/] b", "needs [train] in /x[/y]"))


def test_names_steer_no_terminal():
    table = Table("t", "title\x1b[2J", ("na\x1bme",), (("evil\x1b]0;owned\x07",),), "a note\x1b[31m")
    shown = to_terminal(table)
    assert "\x1b" not in shown and "\x07" not in shown and "owned" in shown


def test_commands_name_no_folder():
    words = ["--workdir", "/home/alice/work", "--policy=/home/alice/x.py", "work/mine", "~/w", "--seed=3", "/"]
    said = ["--workdir", "work", "--policy=x.py", "work/mine", "w", "--seed=3", "/"]
    assert list(map(without_folders, words)) == said


def test_comparison_with_the_paper():
    found = JUDGED.summaries
    assert [s.policy for s in found] == ["act", "bc<script>", "hst"]
    rows = {row[1]: row for row in beside_paper_table("sit-chair", found).rows}
    assert rows["act (improved), as ACT"][2:4] == (Rate(15, 20), Reported(81))
    assert rows["hst (improved), as Improved HST"][3] == Reported(92)
    assert rows["PPO"][2:] == (None, Reported(50), None, Reported(25), None)
    assert "ACT" not in rows
    assert counterpart("imitate", "act-clock") == "ACT"
    assert counterpart("imitate", "planner") is None


def three_tasks():
    """Sitting on chairs of several sizes, lying, and what the paper does not have."""
    sitting = [replace(row, object_id=f"chair-0-{row.episode:05d}") for row in INPUTS.rows]
    lying = [replace(row, task="lie-bed", policy="hit") for row in INPUTS.rows[:20]]
    return Episodes((*sitting, *(replace(row, task="read-book") for row in lying), *lying))


@pytest.mark.parametrize("name", TABLES)
def test_every_table_is_of_one_task_or_of_all(name):
    spec, episodes = TABLES.get(name), three_tasks()
    made = spec.of(episodes)
    apart = [table for one in episodes.by_task for table in spec.of(one)]
    assert spec.what and made
    if spec.per_task:
        unnamed = [replace(table, name="", title="") for table in made]
        assert unnamed == [replace(table, name="", title="") for table in apart], "each as if there were no other"
        assert len({table.title for table in made}) == len({table.name for table in made}) == len(made), "told apart"
    for table in made:
        assert table.title and table.name.startswith(name) and to_markdown(table)
    chairs = episodes.by_task[0]
    if name != "failed":  # which lists episodes in their order
        backwards = Episodes(tuple(reversed(chairs.rows)))
        assert spec.of(backwards) == spec.of(chairs), "methods are ordered by their rates, not by who comes first"


def test_tables_of_several_tasks_say_of_which_they_are():
    made = [table for name in ("beside-paper", "results") for table in TABLES.get(name).of(three_tasks())]
    titles = {table.name: table.title for table in made}
    assert titles["results-sit-chair"] == "Results (sit-chair)"
    assert titles["beside-paper-lie-bed"] == "Ours beside the paper's (LB)", "as the paper calls it, and that once"
    assert [table.title for table in TABLES.get("results").of(JUDGED)] == ["Results"], "there is but one"


def test_the_best_of_tasks_that_the_paper_has_not():
    (table,) = TABLES.get("best").of(three_tasks())
    assert [row[:4] for row in table.rows] == [
        ("SC", "act", Rate(15, 20), Reported(81)),
        ("LB", "hit", Rate(15, 20), Reported(61)),
        ("read-book", "hit", Rate(15, 20), None),
    ]
    assert table.rows[0][5] == Reported(69) and table.rows[2][5] is None
    assert table.rows[0][7:9] == (Rate(18, 20), Reported(92)) and table.rows[2][7:] == (None, None, None)


def test_the_best_is_who_stays_most_often():
    """And of those that stay as often, who fulfils K more often."""

    def judged(policy, successes, stay):
        return [replace(EPISODE, policy=policy, episode=i, success=i < successes, stays=i < stay) for i in range(10)]

    def best(*rows):
        found = best_policy(Episodes(tuple(row for each in rows for row in each)).summaries)
        return found and found.policy

    assert best(judged("leaves", 10, 7), judged("stays", 9, 8)) == "stays"
    assert best(judged("seldom", 8, 8), judged("often", 9, 8)) == "often"
    assert best() is None


def test_failed_episodes_one_by_one():
    (table,) = TABLES.get("failed").of(JUDGED)
    assert len(table.rows) == 5 + 14 + 2, "of three methods"
    assert [row[1] for row in table.rows[:5]] == [f"sit-chair-7-{i:05d}" for i in range(15, 20)]


def test_a_table_that_goes_by_another_name_is_refused():
    spec = TableSpec("mine", "nothing", lambda episodes: [Table("yours", "", ("a",), ())])
    with pytest.raises(MimicbenchError, match="'mine' makes one that calls itself 'yours'; call it 'mine', or"):
        spec.of(JUDGED)


def test_failures_and_breakdowns_add_up():
    act = [row for row in INPUTS.rows if row.policy == "act"]
    kinds = grouping.failures(act)
    # episodes 15 to 19 fail; 15 and 18 by falling, 16 ends away from the chair, 17 and 19 beside it
    assert [kinds[kind].successes for kind in FAILURES] == [2, 0, 0, 1, 2, 0, 0, 0]
    broke = [replace(row, diverged=True, success=False) if row.episode == 19 else row for row in act]
    assert grouping.failures(broke)["physics broke"].successes == 1
    left = [replace(row, stays=False) if row.episode < 4 else row for row in act]
    assert grouping.failures(left)["did not stay"].successes == 4, "who fulfils K and leaves again has failed, too"
    turned = [replace(row, fell_phase="turning") if row.fell else row for row in act]
    assert grouping.failures(turned)["fell turning"].successes == 2
    sat = [replace(row, fell_phase="sitting down") if row.fell else row for row in act]
    assert grouping.failures(sat)["fell at the object"].successes == 2
    for breakdown in grouping.breakdowns(act):
        assert sum(rate.episodes for rate in breakdown.parts.values()) == 20
        assert sum(rate.successes for rate in breakdown.parts.values()) == 15
    assert [b.title for b in grouping.breakdowns(act)] == [
        "Kind of object",
        "Height of the seat",
        "Distance at the start",
    ]
    assert grouping.breakdowns([act[0]] * 4) == []


# --- curves and plots


def test_curves(tmp_path):
    path = tmp_path / "metrics.jsonl"
    lines = [
        json.dumps(
            {"step": i, "samples": 1000 * i, "reward": 0.1 * i, "k": None if i < 2 else 0.5, "ended": {"far": 3}}
        )
        for i in range(4)
    ]
    path.write_text("\n".join(lines) + "\n" + lines[0][:20])
    curve = read_curve(path, "tracker")
    assert curve.x == "samples"
    assert curve.series["k"] == ((2000.0, 0.5), (3000.0, 0.5))
    assert set(curve.series) == {"reward", "k"}
    both = plots.curve_plot("c", curve)
    assert both == plots.curve_plot("c", curve)
    alone = plots.curve_plot("c", replace(curve, series={"reward": curve.series["reward"]}))
    wide = [float(re.search(r'width="([\d.]+)pt"', svg)[1]) for svg in (both, alone)]
    assert wide[1] == pytest.approx(wide[0], rel=0.1), "a page shows both at one width: letters are as large"
    path.write_text("".join(json.dumps({"samples": x, "k": x / 10}) + "\n" for x in (1, 2, 3, 2, 4)))
    assert [x for x, _ in read_curve(path, "resumed").series["k"]] == [1, 2, 4]
    path.write_text(json.dumps({"samples": 1, "other": 2}) + "\n")
    empty = read_curve(path, "just begun")
    assert plots.shown(empty) == []
    with pytest.raises(MimicbenchError, match="just begun"):
        plots.curve_plot("c", empty)
    assert not {"curve-0"} & set(draw_plots("sit-chair", JUDGED, [empty]))
    path.write_text("nonsense\n" + lines[0] + "\n")
    with pytest.raises(BadFile, match="line 1"):
        read_curve(path, "tracker")
    with pytest.raises(BadFile, match="train first"):
        read_curve(tmp_path / "none", "tracker")


def test_what_a_training_says_of_unseen_episodes_is_drawn(tmp_path):
    path = tmp_path / "metrics.jsonl"
    lines = [{"step": step, "loss": 1 / step} for step in (50, 100, 150)]
    path.write_text("".join(json.dumps(line) + "\n" for line in [*lines, {"step": 150, "validation_error": 0.04}]))
    curve = read_curve(path, "bc")
    assert [title for title, _, _ in plots.shown(curve)] == ["Loss", "Error on unseen episodes [rad]"]
    assert "Error on unseen episodes" in plots.curve_plot("c", curve), "on an axis of its own, for it is no loss"


def test_the_training_of_eyes_is_found_where_they_were_trained(tmp_path):
    def lines(loss):
        return "".join(json.dumps({"step": step, "loss": loss}) + "\n" for step in (50, 100, 150))

    def series(loss):
        return ((50.0, loss), (100.0, loss), (150.0, loss))

    place = tmp_path / "sit-chair"
    with by_hand(place / "perception" / "abc", "perception") as eyes:
        (eyes.folder / "metrics.jsonl").write_text(lines(0.5))
        eyes.finish()
    with by_hand(place / "imitate" / "planner-0", "imitate", reads={"perception": eyes.folder}) as stage:
        policy = stage.folder / "policy"
        for name in ("policy", "perception"):
            copy_checkpoint(SHIPPED / "sit-chair" / ("planner" if name == "policy" else name), stage.folder / name)
        (policy / "metrics.jsonl").write_text(lines(0.25))
        stage.finish()
    curves = _curves(Run(small(), tmp_path), str(policy))
    found = {curve.name: curve.series["loss"] for curve in curves if "tracker" not in curve.name}
    assert found == {"eyes": series(0.5), str(policy): series(0.25)}


def test_every_way_to_fail_has_a_color_of_its_own():
    assert len(set(plots.SERIES)) == len(plots.SERIES) >= len(FAILURES)
    style = (Path(plots.__file__).parent / "page.css").read_text()
    for number in range(len(plots.SERIES)):
        light, dark = re.findall(rf"--series-{number}: (#[0-9a-f]{{6}});", style)
        assert light == plots.SERIES[number] and light != dark
    shares = {kind: Rate(1 + number, 100) for number, kind in enumerate(FAILURES)}
    drawn = plots.inline(plots.failures_plot("f", {"ours": shares}))
    assert all(f"var(--series-{number})" in drawn for number in range(len(FAILURES)))


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("lift-box", "is done: at the end, none of this"),
        ("sit-chair", "at some time, for 0.3 s without a break, none of"),
    ],
)
def test_what_is_judged_is_told_in_words(task, words):
    assert words in _judging_html(tasks.TASKS.get(task))


def test_plots_take_the_colors_of_the_page_and_keep_their_ids_apart():
    lines = {"K": [("ours", plots.Mark(Rate(3, 4))), ("paper", plots.Mark(81.0))]}
    one, other = (plots.inline(plots.rates_plot(name, lines)) for name in ("one", "other"))
    assert "var(--series-0)" in one and "http" not in one
    ids = [set(re.findall(r'id="([^"]+)"', svg)) for svg in (one, other)]
    assert ids[0] and not ids[0] & ids[1]
    for used in re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', one):
        assert (used[0] or used[1]) in ids[0]


# --- the page


class Addresses(HTMLParser):
    """Collects everything that a browser would load, and the scripts."""

    def __init__(self):
        super().__init__()
        self.found, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.found += [
            value for name, value in attrs if name in ("src", "href", "xlink:href", "poster", "data", "srcset")
        ]


def test_on_a_phone_panels_stand_below_each_other_and_cells_behind_their_columns():
    drawn, narrow = (draw_plots("sit-chair", JUDGED, [], narrow) for narrow in (False, True))
    assert set(drawn) == set(narrow)
    for name, svg in drawn.items():
        sizes = [
            [float(n) for n in re.findall(r'(?:width|height)="([\d.]+)pt"', one)[:2]] for one in (svg, narrow[name])
        ]
        assert sizes[1][0] < 0.55 * sizes[0][0], f"{name} is as wide as a phone"
    assert "narrow" in narrow["rates"] and not set(re.findall(r'id="([^"]+)"', narrow["rates"])) & set(
        re.findall(r'id="([^"]+)"', drawn["rates"])
    )
    told = str(page.table(Table("t", "t", ("Method", "K & P"), (("a", None), ("b", Rate(1, 2))))))
    assert 'class="none" data-name="K &amp; P">–' in told or 'class="n none" data-name="K &amp; P">–' in told


def test_report_without_pictures_stands_alone_and_regenerates(tmp_path):
    path = write_report(tmp_path / "a", INPUTS)
    html = path.read_text()
    addresses = Addresses()
    addresses.feed(html)
    assert all(address.startswith(("data:", "#")) for address in addresses.found)
    assert not re.search(r"https?://|@import|url\((?!#)", html)
    assert not {"link", "iframe"} & set(addresses.tags)
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert addresses.tags.count("script") == 1 and f"script-src 'sha256-{digest}'" in html, "no other script may run"
    assert "bc&lt;script&gt;" in html
    assert "<b>75.0 %</b>" in html and "15/20" in html
    write_report(tmp_path / "b", INPUTS)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path / "b") for p in (tmp_path / "b").rglob("*") if p.is_file())
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
    assert {"tables/results.md", "tables/beside-paper.tex", "tables/breakdown.csv", "plots/rates.svg"} <= {
        file.as_posix() for file in files
    }
    assert len(read_rows(tmp_path / "a" / "episodes.parquet")) == 60


def test_report_does_not_depend_on_the_order_of_episodes_of_different_policies(tmp_path):
    write_report(tmp_path / "a", INPUTS)
    rows = tuple(sorted(INPUTS.rows, key=lambda row: row.episode))
    write_report(tmp_path / "b", replace(INPUTS, rows=rows))
    assert (tmp_path / "a" / "index.html").read_bytes() == (tmp_path / "b" / "index.html").read_bytes()


def test_a_page_lists_some_failed_episodes_and_the_table_has_all(tmp_path):
    lost = replace(INPUTS.rows[0], success=False, success_at_end=False, stays=False, first_success_time=None)
    rows = tuple(replace(lost, episode=i) for i in range(61))
    html = write_report(tmp_path, replace(INPUTS, rows=rows)).read_text()
    assert "The first 60 of 61; tables/failed.csv has all." in html
    assert "sit-chair-7-00059" in html and "sit-chair-7-00060" not in html
    assert len(list(csv.reader((tmp_path / "tables" / "failed.csv").open()))) == 1 + 61


def test_report_refuses_nothing_and_mixtures(tmp_path):
    with pytest.raises(MimicbenchError, match="no episodes"):
        write_report(tmp_path, replace(INPUTS, rows=()))
    with pytest.raises(MimicbenchError, match="lie-bed"):
        write_report(tmp_path, replace(INPUTS, rows=(*INPUTS.rows, replace(INPUTS.rows[0], task="lie-bed"))))
    assert not list(tmp_path.iterdir())


def test_report_of_one_perfect_policy(tmp_path):
    rows = tuple(row for row in INPUTS.rows if row.policy == "act" and row.success)
    html = write_report(tmp_path, replace(INPUTS, rows=rows)).read_text()
    assert "No episode failed." in html


def test_nothing_unescaped_gets_into_a_page(tmp_path):
    evil = "<script>\"'&"
    cells = Table("t", evil, (evil, "K"), ((evil, Rate(1, 2)), (evil, Reported(3))), note=evil, source=evil)
    (tmp_path / "picture").write_bytes(b"1")
    pieces = (
        page.paragraph(evil),
        page.heading(evil),
        page.table(cells),
        page.code(evil),
        page.facts({evil: evil}),
        page.folded(evil, page.paragraph(evil)),
        page.stage(evil, evil, tmp_path / "picture"),
        page.videos([(evil, tmp_path / "picture")]),
        page.gallery(evil, [(evil, tmp_path / "picture")]),
        page.objects([(tmp_path / "picture", evil, evil, 1, 2)]),
        page.judging(20.0, 0.3),
        page.plot([plots.rates_plot("rates", {evil: [(evil, plots.Mark(Rate(1, 2), 0))]})] * 2, evil),
    )
    sections = [page.Section(evil, page.joined(pieces)), page.Section("plain text", evil), page.Section("none", "")]
    html = page.page(evil, evil, evil, [page.Tile(evil, evil, evil, (evil,))], sections, evil)
    assert html.count("<script") == 1 and html.count("&lt;script&gt;") >= 20
    assert not re.search(r"=\"[^\"]*<script", html)
    mixed = page.paragraph("x") + evil  # type: ignore[operator]
    assert "<script" not in mixed and mixed.startswith("<p>x</p>"), "plain text beside a piece is escaped"


# --- pictures


def human(frames=40):
    path = np.zeros((frames, 3))
    path[:, 0], path[:, 2] = np.linspace(1.5, 0.4, frames), 0.88
    quat = np.zeros((frames, 15, 4))
    quat[..., 0] = 1
    quat[:, 0] = rot.from_yaw(np.full(frames, 3.0))
    return HumanMotion("clip", "sit-chair", UNIHSI, 30, path, quat, CHAIR.id)


def robot_motion(frames=40):
    motion = human(frames)
    joints = np.tile(ROBOT.rest_pose, (frames, 1))
    return RobotMotion(
        "clip",
        "sit-chair",
        "h1",
        ROBOT.joint_names,
        30,
        motion.root_pos_w,
        motion.local_quat[:, 0],
        joints,
        CHAIR.id,
        "clip",
    )


def assert_seen(camera, points, aspect):
    """That points (N, 3) are in the picture."""
    yaw, pitch = np.radians(camera.azimuth), np.radians(camera.elevation)
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0])
    points = points - (np.array(camera.lookat) - camera.distance * forward)
    depth, limit = points @ forward, np.tan(FIELD_OF_VIEW / 2)
    assert (depth > 0).all()
    assert (abs(points @ right) <= aspect * limit * depth).all()
    assert (abs(points @ np.cross(right, forward)) <= limit * depth).all()


def test_camera_sees_all():
    path = np.array([[1.0, 2.0, 0.9], [2.5, -0.5, 0.9], [0.2, 0.0, 0.6]])
    corners = CHAIR.corners().reshape(-1, 3)
    points = np.concatenate([path * [1, 1, 0], path * [1, 1, 0] + [0, 0, 1.8], corners])
    for aspect in (1.2, 1.6):
        assert_seen(frame_all(CHAIR, path, aspect), points, aspect)


@pytest.mark.parametrize("half", [(0.02, 0.45, 1.05), (1.5, 0.3, 0.2), (0.1, 0.1, 0.1)])
def test_a_sheets_camera_sees_all_of_each(half):
    half = np.array([half])
    box = SceneObject("box-0-00000", "box", "box", half * [0, 0, 1], rot.IDENTITY[None], half, np.full((1, 3), 0.5))
    for other in ([], [CHAIR]):
        points = np.concatenate([obj.corners().reshape(-1, 3) for obj in (box, *other)])
        assert_seen(sheet_camera([box, *other], CELL), points, CELL.width / CELL.height)


def test_moments_are_even_in_what_happens():
    path = np.zeros((101, 3))
    path[:51, 0], path[51:, 0] = np.linspace(0, 2, 51), 2.0  # goes two meters, then stays
    quat = np.tile([1.0, 0, 0, 0], (101, 1))
    assert moments(path, quat, 5).tolist() == [0, 13, 25, 38, 50]
    assert moments(path * 0, quat, 3).tolist() == [0, 0, 0]


def test_person_grows_with_its_skeleton_and_any_skeleton_can_be_drawn():
    solids = solids_of(UNIHSI)
    bigger = solids_of(UNIHSI.scaled(1.1))
    assert bigger[0].size == pytest.approx(tuple(1.1 * s for s in solids[0].size))
    motion = human(2)
    pos, quat = motion.forward_kinematics()
    heights = [part.at_w[2] + part.solid.size[2] for part in place(solids, UNIHSI, pos[0], quat[0])]
    assert 1.55 < max(heights) < 1.75
    other = replace(UNIHSI, name="other")
    assert len(solids_of(other)) == 14


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=list(SKELETONS))
def test_people_of_all_skeletons_are_dressed_alike(skeleton):
    for size in (0.9, 1.0, 1.1):
        body = body_of(skeleton.scaled(size))
        quat = np.tile(rot.IDENTITY, (len(skeleton.joint_names), 1))
        pos, quat = forward_kinematics(body.skeleton, np.array([0, 0, body.standing_height]), quat)
        solids = solids_of(body.skeleton)
        placed = place(solids, body.skeleton, pos, quat)
        colors = {part.solid.rgb for part in placed}
        assert colors == {SKIN, HAIR, EYES, SHIRT, TROUSERS, SHOES, SOLES}
        # on the floor, with soles and nothing else below them; a face that looks ahead; the left the right's mirror
        # image
        low: dict[tuple[float, float, float], float] = {}
        for part in placed:
            bottom = min(part.at_w[2], part.to_w[2]) - part.solid.size[0 if part.solid.kind == "capsule" else 2]
            low[part.solid.rgb] = min(bottom, low.get(part.solid.rgb, bottom))
        assert abs(low[SOLES]) < 1e-9 and all(bottom > -1e-9 for bottom in low.values())
        top = max(part.at_w[2] + part.solid.size[2] for part in placed if part.solid.rgb == HAIR)
        assert top == pytest.approx({"unihsi": 1.63, "roam": 1.65, "core4d": 1.85}[skeleton.name] * size, abs=0.03)
        assert min(part.at_w[0] for part in placed if part.solid.rgb == EYES) > pos[body.head, 0] + 0.05
        middles = np.array([(part.at_w + part.to_w) / 2 for part in placed])
        assert sorted(np.round(middles[:, 1], 9)) == sorted(np.round(-middles[:, 1], 9))


def test_positions_follow_names_and_refuse_other_robots(model):
    motion = robot_motion(3)
    turned = replace(motion, joint_names=motion.joint_names[::-1], joint_pos=motion.joint_pos[:, ::-1])
    assert np.array_equal(positions(motion, model), positions(turned, model))
    assert np.allclose(positions(motion, model)[0], [*motion.root_pos_w[0], *motion.root_quat_w[0], *ROBOT.rest_pose])
    with pytest.raises(BadMotion, match="no joint"):
        positions(replace(motion, joint_names=("wing", *motion.joint_names[1:])), model)
    with pytest.raises(MimicbenchError, match="another robot"):
        next(iter(robot_frames(model, np.zeros((2, 5)), CAMERA)))


def test_boxes_move_and_goals_are_red():
    box = make_object("box-0-00000")
    model = build_model(ROBOT, box, visuals=True)
    motion = replace(
        human(2), object_pos_w=np.array([[0, 0, 0], [0.0, 0, 0.5]]), object_quat_w=np.tile(rot.IDENTITY, (2, 1))
    )
    assert np.array_equal(with_object(model, motion)[:, -7:-4], motion.object_pos_w)
    robot_clip = replace(robot_motion(2), object_pos_w=motion.object_pos_w, object_quat_w=motion.object_quat_w)
    assert np.array_equal(positions(robot_clip, model)[1, -7:-4], [0, 0, 0.5])
    goal = replace(motion, wrist_goal_w=np.array([[1.0, 0.4, 1.0], [1.0, -0.4, 1.0]]))

    def red(frame):
        return int(((frame[..., 0] > 150) & (frame[..., 1] < 60) & (frame[..., 2] < 60)).sum())

    try:
        before, after = human_frames(model, motion, np.array([0.0, 1.0]), CAMERA, SMALL)
        marked = next(human_frames(model, goal, np.zeros(1), CAMERA, SMALL))
        robot = next(robot_frames(model, positions(robot_clip, model)[:1], CAMERA, SMALL, goal.wrist_goal_w))
    except NoPictures as error:
        pytest.skip(str(error))
    assert (abs(before.astype(int) - after) > 30).any(-1).sum() > 20
    assert red(before) == 0 < red(marked) and red(robot) > 0


def test_pictures_show_robot_and_object(model):
    with painter_or_skip(model) as painter:
        standing = painter.draw(positions(robot_motion(2), model)[0])
        away = painter.draw(np.array([50.0, 50, -30, 1, 0, 0, 0, *ROBOT.rest_pose]))
    assert standing.shape == (64, 96, 3) and standing.dtype == np.uint8
    assert 0.01 < (abs(standing.astype(int) - away).max(-1) > 30).mean() < 0.5
    assert standing.std() > 10


def test_no_opengl_is_one_clear_error(model, monkeypatch, tmp_path):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoPictures, match="libegl1"):
        Painter(model, SMALL, CAMERA)
    heard = []
    showcase = Showcase(CHAIR, "h1", (Clip("Human", "", human()),))
    html = write_report(tmp_path, replace(INPUTS, showcase=showcase), heard.append).read_text()
    assert "no OpenGL" in html and "no OpenGL" in heard[0]
    assert not (tmp_path / "media").exists() or not list((tmp_path / "media").iterdir())


def test_showcase_draws_once(tmp_path, model):
    painter_or_skip(model).close()
    config = ShowConfig(moments=3, still=SMALL, video=SMALL, fps=5)
    recording = Recording(positions(robot_motion(), model), 30)
    clips = (
        Clip("Human", "note", human()),
        Clip("Retargeted", "note", robot_motion()),
        Clip("Tracked", "note", recording),
    )
    heard = []
    inputs = replace(INPUTS, showcase=Showcase(CHAIR, "h1", clips), show=config)
    html = write_report(tmp_path, inputs, heard.append).read_text()
    assert html.count("data:video/mp4;base64,") == html.count("data:image/jpeg;base64,") == 3
    assert not heard
    made = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "media").iterdir()}
    shown = draw(inputs.showcase, tmp_path / "media", config)
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "media").iterdir()} == made, (
        "finished pictures are not drawn again"
    )
    assert iio.imread(shown[0].strip).shape == (64, 3 * 96 + 2 * 4, 3)
    for each in shown:
        # 39/30 s at 5 frames per second, both ends included
        assert len(iio.imread(each.video, plugin="FFMPEG")) == 7
    assert not list((tmp_path / "media").glob(".*"))


def test_motions_of_different_length_are_films_of_one_length(tmp_path, model):
    painter_or_skip(model).close()
    config = ShowConfig(moments=2, still=SMALL, video=SMALL, fps=5)
    clips = (Clip("Human", "", human(10)), Clip("Retargeted", "", robot_motion(40)))
    brief, long = draw(Showcase(CHAIR, "h1", clips), tmp_path, config)
    assert brief.seconds == pytest.approx(9 / 30) and long.seconds == pytest.approx(39 / 30)
    films = [iio.imread(each.video, plugin="FFMPEG").astype(int) for each in (brief, long)]
    assert len(films[0]) == len(films[1]) == 7
    assert abs(films[0][2] - films[0][3]).max() < 12 < abs(films[0][0] - films[0][1]).max(), "it rests"


def test_failures_are_filmed_around_the_fall_and_objects_counted(tmp_path, model):
    painter_or_skip(model).close()
    fallen = next(row for row in INPUTS.rows if row.fell)
    slow = next(row for row in INPUTS.rows if not row.success and not row.fell)
    failed = [Failed(row, replace(robot_motion(200), fps=25), CHAIR) for row in (fallen, slow)]
    assert failed[0].part == (1.0, 5.5) and failed[1].part == pytest.approx((4.96, 7.96))
    assert failed[0].caption.startswith("fell walking · ") and "1.0 to 5.5 s" in failed[0].caption
    paths = draw_failures(failed, tmp_path, fps=5)
    assert [len(iio.imread(path, plugin="FFMPEG")) for path in paths] == [23, 15]
    made = [path.stat().st_mtime_ns for path in paths]
    assert [path.stat().st_mtime_ns for path in draw_failures(failed, tmp_path, fps=5)] == made, "not drawn again"
    other = make_object("chair-0-00004")
    rows = [replace(row, object_id=CHAIR.id if row.episode < 10 else other.id) for row in INPUTS.rows[:20]]
    found = counted(rows, [CHAIR, other, make_object("chair-0-00005")])
    assert [(one.obj.id, one.rate.counts()) for one in found] == [(other.id, "5/10"), (CHAIR.id, "10/10")]
    tiles = draw_objects(found, tmp_path)
    assert iio.imread(tiles[0]).shape == (130, 150, 3) and iio.imread(tiles[0]).std() > 5
    showcase = Showcase(CHAIR, "h1", (Clip("Human", "note", human()),))
    config = ShowConfig(moments=2, still=SMALL, video=SMALL, fps=5)
    inputs = replace(INPUTS, failed=tuple(failed), showcase=showcase, show=config, objects={CHAIR.id: CHAIR})
    rows = tuple(replace(row, object_id=CHAIR.id) for row in INPUTS.rows)
    html = write_report(tmp_path / "page", replace(inputs, rows=rows)).read_text()
    assert html.count("data:video/mp4") == 3 and html.count("data:image/jpeg") == 2
    assert "Some that failed: act" in html and "<b>15/20</b>" in html


def test_strip_and_video_by_hand(tmp_path):
    frames = [np.full((32, 48, 3), 20 * i, np.uint8) for i in range(10)]
    assert strip(frames[:3], gap=2).shape == (32, 3 * 48 + 2 * 2, 3)
    assert strip(frames[:1], ["1.0 s"]).max() > 0
    assert write_video(tmp_path / "v.mp4", iter(frames), 10) == 10
    video = iio.imread(tmp_path / "v.mp4", plugin="FFMPEG")
    assert video.shape == (10, 32, 48, 3)
    assert abs(video[5].astype(int).mean() - 100) < 8


def test_what_a_killed_report_was_writing_is_removed(tmp_path):
    """Killed in the middle of a video, it cannot tidy up; whoever holds the folder next does."""
    script = f"""
import time
from pathlib import Path
import numpy as np
from mimicbench.report.video import write_video
path = Path({str(tmp_path)!r}) / "videos" / "v.mp4"
def frames():
    while not list(path.parent.glob(".v.*")):
        yield np.zeros((32, 48, 3), np.uint8)
    print("drawn", flush=True)
    time.sleep(60)
write_video(path, frames(), 10)
"""
    child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "drawn\n"
    child.kill()
    child.wait()
    left = list((tmp_path / "videos").iterdir())
    assert len(left) == 1 and left[0].name.startswith(".v.")
    (tmp_path / "videos" / "other.mp4").touch()
    remove_unfinished(tmp_path)
    assert [path.name for path in (tmp_path / "videos").iterdir()] == ["other.mp4"]


def test_video_leaves_nothing_behind_when_it_fails(tmp_path):
    def broken():
        yield np.zeros((32, 48, 3), np.uint8)
        raise RuntimeError("the scene broke")

    with pytest.raises(RuntimeError):
        write_video(tmp_path / "v.mp4", broken(), 10)
    for frames, message in (
        ([], "no pictures"),
        ([np.zeros((31, 48, 3), np.uint8)], "even"),
        (
            [
                np.zeros((32, 48, 3)),
            ],
            "bytes",
        ),
    ):
        with pytest.raises(MimicbenchError, match=message):
            write_video(tmp_path / "v.mp4", iter(frames), 10)
    with pytest.raises(MimicbenchError, match="one size"):
        write_video(tmp_path / "v.mp4", iter([np.zeros((32, 48, 3), np.uint8), np.zeros((48, 32, 3), np.uint8)]), 10)
    with pytest.raises(MimicbenchError, match="captions"):
        strip([np.zeros((32, 48, 3), np.uint8)], ["a", "b"])
    assert not list(tmp_path.iterdir())


def test_contact_sheet():
    objects = [FAMILIES.get("chair").make(i, 0) for i in range(7)]
    try:
        sheet = contact_sheet(objects, columns=3, cell=SMALL)
    except NoPictures as error:
        pytest.skip(str(error))
    assert sheet.shape == (3 * SMALL.height, 3 * SMALL.width, 3)
    first, second = sheet[: SMALL.height, : SMALL.width], sheet[: SMALL.height, SMALL.width : 2 * SMALL.width]
    assert first.std() > 5 and not np.array_equal(first, second)
    assert (sheet[2 * SMALL.height :, SMALL.width :] == 255).all(), "cells without an object are white"
    with pytest.raises(MimicbenchError, match="400"):
        contact_sheet([])

"""The command line: bad input gets one clear sentence, exit status 2, and nothing is written."""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mimicbench import __version__, cli
from mimicbench.benchmark.presets import PRESETS
from mimicbench.commands.telling import tell
from mimicbench.core.files import write_json
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS


def command(*arguments: str, cwd: Path, **more) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "mimicbench.cli", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=120,
        check=False,
        **more,
    )


def refused(result: subprocess.CompletedProcess[str], cwd: Path, *words: str) -> None:
    assert result.returncode == 2, result.stderr
    message = result.stderr.strip().splitlines()[-1]
    assert message.startswith("mimicbench: ") and "Traceback" not in result.stderr
    for word in words:
        assert word in message
    assert not (cwd / "work").exists(), "a refused call leaves nothing behind"


def called(*words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Status and last line of a call in this process."""
    with pytest.raises(SystemExit) as left:
        cli.main(words)
    return int(left.value.code or 0), capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("objects --task sit-lamp", "unknown task 'sit-lamp'; known are: lie-bed"),
        ("objects --count -5", "objects.count is -5; give 1 to 10000000"),
        ("objects --count 0", "objects.count is 0"),
        ("references --count 0", "references.count is 0"),
        ("objects --seed -1", "seed is -1"),
        ("objects --workers -3", "--workers is -3; give 1 to 4096, or 0"),
        ("objects --workdir=", "--workdir is empty"),
        ("objects --robot r2d2", "unknown robot 'r2d2'"),
        ("objects --preset mine", "unknown preset 'mine'; known are:"),
        ("objects --config nowhere.toml", "nowhere.toml does not exist"),
        ("objects --source ../x", "objects.source is '../x'"),
        ("references --source mine", "`mimicbench import FILE --to mine --workdir work` makes the set 'mine'"),
        ("retarget --method guess", "unknown retargeting method 'guess'"),
        ("retarget --method omnih2o --variant improved", "omnih2o"),
        ("references --references.source a --objects.source b", "brings its own objects"),
        ("references stats --picture plots.pdf", "--picture is 'plots.pdf'; give a name that ends in .png"),
        ("retarget draw --out clips.svg", "--out is 'clips.svg'; give a name that ends in .png"),
        ("objects draw --out objects", "--out is 'objects'; give a name that ends in .png"),
        ("references augment --to made", "--to is 'made'"),
        ("references augment --count 0", "--count is 0"),
        ("bench --seconds nan", "--seconds is nan; give a finite number"),
        ("bench world --sizes 0", "--sizes is (0,)"),
        ("bench world --sizes", "--sizes has no numbers; give at least one"),
        ("bench soak --threads", "--threads has no numbers; give at least one"),
        ("table", "give at least one file"),
        ("table --show bets", "did you mean 'best'?"),
        ("table --show BEST", "did you mean 'best'?"),
        ("export motion .", ". is a folder; give a file in it"),
        ("import .", "it is a folder; give the files in it"),
        ("view --policy nobody.py", "nobody.py does not exist"),
        ("table --show bets", "unknown table 'bets'; known are: beside-paper, best,"),
        ("import nowhere.npy", "nowhere.npy"),
        ("dance", "there is no command 'dance'; there are: objects,"),
        ("evalute", "did you mean 'evaluate'?"),
    ],
)
def test_what_is_refused_is_told_in_one_sentence(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, message = called(*words.split(), capsys=capsys)
    assert status == 2 and message.startswith("mimicbench: ") and said in message
    assert not list(tmp_path.iterdir()), "a refused call leaves nothing behind"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("track --samples 0", "track.samples is 0"),
        ("track --ppo.entropy nan", "track.ppo.entropy is nan"),
        ("track --ppo.gamma 1.5", "track.ppo.gamma is 1.5; give 0 to 1"),
        ("imitate --learner parrot", "unknown learner 'parrot'; known are:"),
        ("imitate --planner.samples 0", "imitate.planner.samples is 0"),
        ("imitate --learner bc --train.steps -1", "imitate.train.steps is -1"),
        ("imitate --learner act --track.tracker hst --gains improved", "imitate.gains is 'improved'"),
        ("imitate --learner act --network.dropout 2", "imitate.network.dropout is 2"),
        ("imitate --learner bc --demos.expert nonesuch", "demos.expert is 'nonesuch', where no policy is"),
        ("imitate --learner bc --demos.expert planner --gains paper", "leave imitate.gains out"),
        ("evaluate --episodes 0", "evaluate.episodes is 0"),
        ("evaluate --policy nobody", "unknown policy 'nobody'; known are:"),
        ("evaluate --policy ./nowhere", "config.json does not exist"),
        (
            "evaluate --task lie-bed --policy planner",
            "no planner is shipped for lie-bed (only for sit-chair, touch-points)",
        ),
        (
            "evaluate --policy hit --task lie-bed",
            "no hit is shipped for any task, and no hit was made by this recipe in work; make it with `mimicbench",
        ),
        ("references remake nope", "'nope' is no clip's id such as sit-chair-0-00042, nor is 'nope' a task"),
        ("run --task all --policy planner", "no planner is shipped for sit-sofa (only for sit-chair, touch-points)"),
        ("run --policy tracker", "a report shows a policy"),
        ("run --train --policy mine.py", "with --train the report is of what is learned here, which 'mine.py' is not"),
        ("run --train --policy ./mine", "name learners (online, planner, act, "),
        ("run --train --policy best", "or judge it without --train"),
        ("run --train --imitate.learner act --profile smoke", "--imitate.learner act is not among what is judged"),
        ("run --train --policy parrot", "unknown learner 'parrot'; known are:"),
        ("run --profile smok", "--profile is 'smok'; give one of smoke, default, full"),
        ("references stats --task sit-lamp", "unknown task 'sit-lamp'; known are: lie-bed"),
        ("bench robust --clips 1 --tasks sit-chair sit-lamp", "unknown task 'sit-lamp'"),
        ("bench robust --clips 1 --tasks sit-chair --tracker planner", "'planner' is a policy, and follows no clips"),
    ],
)
def test_what_learns_is_refused_before_any_work(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, message = called(*words.split(), capsys=capsys)
    assert status == 2 and message.startswith("mimicbench: ") and said in message
    assert not list(tmp_path.iterdir()), "a refused call leaves nothing behind"


def test_files_of_policies_are_told_apart(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for path in ("mine.py", "a/mine.py"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text("")
    _, message = called("evaluate", "--policy", "mine.py", "a/mine.py", capsys=capsys)
    assert "mine.py and a/mine.py are both called 'mine' in rows and tables; rename one" in message
    _, message = called("evaluate", "--policy", "mine", capsys=capsys)
    assert message.strip().endswith("for the file, give --policy mine.py")


def test_names_of_folders_do_not_steer_the_terminal(capsys):
    tell([{"folder": "a\x1b[31m"}], False, "objects: count 1 (a\x1b[31m)\nsecond line")
    assert capsys.readouterr().out == "objects: count 1 (a\\x1b[31m)\nsecond line\n"


def test_a_missing_policy_is_told_with_the_command_that_makes_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, message = called("evaluate", "--task", "lift-box", "--policy", "bc", capsys=capsys)
    assert "`mimicbench imitate --learner bc --task lift-box --workdir work`" in message


def test_hostile_pickle_is_refused_and_not_executed(tmp_path):
    class Hostile:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "executed",))

    with open(tmp_path / "evil.npy", "wb") as stream:
        pickle.dump(np.array([Hostile()], dtype=object).item(), stream)
    refused(command("import", "evil.npy", cwd=tmp_path), tmp_path, "evil.npy")
    assert not (tmp_path / "executed").exists()


def test_cut_off_recording(tmp_path):
    (tmp_path / "cut.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr'")
    refused(command("import", "cut.npy", cwd=tmp_path), tmp_path, "cut.npy")


def test_checkpoint_of_another_robot(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "policy"
    write_json(folder / "config.json", {"format": 1, "kind": "act", "robot": "g1", "config": {}, "notes": {}})
    (folder / "model.safetensors").write_bytes(b"")
    words = ("evaluate", "--policy", str(folder), "--episodes", "1", "--objects.count", "8", "--workers", "1", "--json")
    status, message = called(*words, capsys=capsys)
    assert status == 2 and "another robot" in message


def test_stages_print_one_line_of_json_and_repeat_for_free(tmp_path):
    arguments = ("--count", "8", "--workdir", "w", "--seed", "5", "--json")
    first = command("objects", *arguments, cwd=tmp_path)
    found = json.loads(first.stdout)
    assert found["stage"] == "objects" and found["count"] == 8 and first.stdout.count("\n") == 1
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "w").rglob("*.json")}
    assert command("objects", *arguments, cwd=tmp_path).stdout == first.stdout
    assert stamps == {path: path.stat().st_mtime_ns for path in (tmp_path / "w").rglob("*.json")}
    more = command("objects", "--count", "9", "--workdir", "w", "--seed", "5", "--json", cwd=tmp_path)
    assert json.loads(more.stdout)["folder"] == found["folder"] and json.loads(more.stdout)["count"] == 9
    assert stamps.items() >= {p: p.stat().st_mtime_ns for p in stamps if p.name != "header.json"}.items()
    everything = command("objects", "--task", "all", "--count", "2", "--workdir", "w", "--json", cwd=tmp_path)
    assert [one["task"] for one in json.loads(everything.stdout)][:2] == ["sit-chair", "sit-sofa"]


def test_help_and_version(capsys):
    for words in (["--help"], []):
        cli.main(words)
        assert "  retarget compare    Compare the ways to retarget." in capsys.readouterr().out
    cli.main(["--version"])
    assert capsys.readouterr().out == f"mimicbench {__version__}\n"


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_signals_end_a_command_alike(number, status, tmp_path):
    words = [sys.executable, "-m", "mimicbench.cli", "references", "--count", "4000", "--workers", "1", "--json"]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}

    def heed():  # what a shell starts in the background ignores an interrupt, and so do its children
        signal.signal(number, signal.SIG_DFL)

    process = subprocess.Popen(words, cwd=tmp_path, text=True, preexec_fn=heed, **pipes)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("work/*/references/*/*.npz")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    assert process.returncode == status and "mimicbench: stopped; the same command goes on from here" in told
    assert "Traceback" not in told and not list(tmp_path.rglob("*.tmp*"))


def test_errors_of_the_system_are_one_sentence(tmp_path):
    (tmp_path / "work").write_text("a file")
    there = command("objects", "--count", "2", cwd=tmp_path)
    assert there.returncode == 74 and "mimicbench: Not a directory" in there.stderr and "Traceback" not in there.stderr
    if os.geteuid() != 0:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o500)
        denied = command("objects", "--count", "2", "--workdir", "locked/w", cwd=tmp_path)
        assert denied.returncode == 77 and "Permission denied" in denied.stderr
    full = Path("/dev/full")
    if full.exists():
        with full.open("w") as stream:
            words = [sys.executable, "-m", "mimicbench.cli", "--help"]
            done = subprocess.run(words, stdout=stream, stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 74 and "No space left on device" in done.stderr and "Traceback" not in done.stderr


def test_a_closed_pipe_is_no_error():
    words = f"{sys.executable} -m mimicbench.cli --help | head -c 1 > /dev/null; exit ${{PIPESTATUS[0]}}"
    for _ in range(3):
        done = subprocess.run(["bash", "-c", words], capture_output=True, text=True, check=False)
        assert done.returncode in (0, 141) and not done.stderr
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "mimicbench.cli", "--help"],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert done.returncode == 141 and not done.stderr


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["mimicbench", "ev"], ["evaluate"]),
        (["mimicbench", "bench", "so"], ["soak"]),
        (["mimicbench", "objects", "draw", "--wor"], ["--workdir", "--workers"]),
        (["mimicbench", "table", "--sh"], ["--show"]),
    ],
)
def test_bash_completes_commands_and_settings(words, expected, tmp_path):
    program = tmp_path / "mimicbench"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m mimicbench.cli "$@"\n')
    program.chmod(0o755)
    line = " ".join(f"'{word}'" for word in words)
    script = f"""
        export PATH={tmp_path}:$PATH
        eval "$(mimicbench --completion)"
        COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}
        _mimicbench; printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.split() == expected, done.stderr


def test_help_names_what_there_is(capsys):
    with pytest.raises(SystemExit):
        cli.main(["retarget", "--help"])
    said = capsys.readouterr().out
    for names in (TASKS, ROBOTS, PRESETS, METHODS):
        assert ", ".join(names) in said
    assert "--imitate.learner" not in said


def test_json_has_no_nan(capsys):
    tell([{"area": float("nan"), "spread": (1.0, float("inf")), "of": {"clips": 3, "fell": True}}], True, "")
    assert json.loads(capsys.readouterr().out, parse_constant=pytest.fail) == {
        "area": None,
        "spread": [1.0, None],
        "of": {"clips": 3, "fell": True},
    }

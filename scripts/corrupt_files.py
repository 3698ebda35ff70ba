"""Damage files of every kind that we write, and read them: each is refused in one sentence, or reads as whole.

python scripts/corrupt_files.py --count 5000      # this many damaged files, spread over the kinds
"""

import argparse
import dataclasses
import hashlib
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.stage import StageKey, opened, read_stage
from mimicbench.core.training import NetworkState, resume_training, save_training
from mimicbench.evaluate.rows import EpisodeRow, read_rows, write_rows
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import load_object, save_object
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.robots.registry import ROBOTS

IDENTITY = {"seed": 0, "clips": ["a", "b"]}


@dataclass(frozen=True)
class Kind:
    """A kind of file."""

    files: str
    """Which files of the folder are damaged, one at a time."""
    write: Callable[[Path], object]
    read: Callable[[Path], Any]


def objects(folder: Path) -> None:
    """A chair, and a box that can be lifted."""
    for family in ("chair", "box"):
        save_object(folder, FAMILIES.get(family).make(3, 0))


def people(folder: Path) -> None:
    """A person who sits down."""
    synthesize("sit-chair", 0, FAMILIES.get("chair").make(0, 0), 0).thinned(8).save(folder / "human.npz")


def robots(folder: Path) -> None:
    """A robot with a box and with goals for its wrists."""
    joints, random = ROBOTS.get("h1").joint_names, np.random.default_rng(0)
    quat = np.tile([1.0, 0, 0, 0], (40, 1))
    arrays = {"root_pos_w": random.normal(size=(40, 3)), "joint_pos": random.normal(size=(40, len(joints)))}
    held = {"object_pos_w": random.normal(size=(40, 3)), "object_quat_w": quat, "wrist_goal_w": np.ones((2, 3))}
    motion = RobotMotion("a", "lift-box", "h1", joints, 50.0, root_quat_w=quat, object_id="b", reference_id="a",
                         style={"speed": 1.5}, measures={"skate": 0.25}, **arrays, **held)  # fmt: skip
    motion.save(folder / "robot.npz")


def stage(folder: Path) -> None:
    """A header."""
    key = StageKey("objects", "sit-chair", 3, {"family": "chair"}, {"x": "01234567"}, {"count": 400}, ("chair",))
    with opened(folder, key, {"task": "sit-chair", "seed": 3}) as one:
        one.finish(count=400, rate=0.5)


def network(folder: Path) -> None:
    """A checkpoint."""
    tensors = {"weight": np.random.default_rng(0).normal(size=(30, 20)).astype(np.float32), "count": np.array(7)}
    save_checkpoint(folder, "tracker", "h1", {"hidden": [30, 20], "rate": 0.5}, tensors, {"samples": 5, "seed": 1})


def training(folder: Path) -> None:
    """A training's state."""
    torch.manual_seed(0)
    save_training(folder, IDENTITY, {"net": NetworkState(torch.nn.Linear(30, 20))}, {"step": 5, "seconds": 1.5})


def resumed(folder: Path) -> Any:
    """What a training goes on from."""
    net = torch.nn.Linear(30, 20)
    progress = resume_training(folder, IDENTITY, {"net": NetworkState(net)}, {"step": 0, "seconds": 0.0})
    return progress, {name: value.numpy() for name, value in net.state_dict().items()}


def demos(folder: Path) -> None:
    """A data set of three shards."""
    random = np.random.default_rng(0)
    writer = DemoWriter(folder, "h1", "sit-chair", tuple(f"joint{i}" for i in range(19)), shard_episodes=2)
    for number in range(5):
        widths = {"state": 300, "action": 19, "executed_action": 19, "qpos": 26, "qvel": 25}
        arrays: Any = {name: random.normal(size=(6 + number, width)) for name, width in widths.items()}
        arrays["scene"] = random.normal(size=(6 + number, 12))
        arrays["picture"] = random.integers(0, 256, (6 + number, 16, 16)).astype(np.uint8)
        writer.add(Demonstration(**arrays, object_id="chair-0-00001", reference_id=f"clip-{number}", success=True))
    writer.finish()


def rows(folder: Path) -> None:
    """Rows of episodes."""
    words = {"task": "sit-chair", "stage": "track", "policy": "tracker", "preset": "improved", "robot": "h1",
             "object_id": "chair-0-00001", "object_kind": "dining", "split": "test", "reference_id": "a",
             "mimicbench": "0.1.0", "mujoco": "3.17.0", "fell_phase": ""}  # fmt: skip
    given = EpisodeRow(
        **words, seed=0, episode=0, steps=300, success=True, success_at_end=True, stays=True, first_success_time=5.5,
        fell=False, fell_time=None, diverged=False, max_energy=5e4, seat_height=0.45, start_distance=2.5,
        end_distance=0.0,
    )  # fmt: skip
    many = [dataclasses.replace(given, episode=i, max_energy=5e4 + 7 * i) for i in range(40)]
    write_rows(folder / "rows.parquet", many, {"clips": "01234567", "episodes": 40})


KINDS: Mapping[str, Kind] = {
    "objects": Kind("*.json", objects, lambda folder: [load_object(folder, p.stem) for p in sorted(folder.glob("*"))]),
    "people": Kind("*.npz", people, lambda folder: HumanMotion.load(folder / "human.npz")),
    "robots": Kind("*.npz", robots, lambda folder: RobotMotion.load(folder / "robot.npz", "h1")),
    "stages": Kind("header.json", stage, lambda folder: read_stage(folder).header),
    "networks": Kind("*", network, lambda folder: load_checkpoint(folder, "tracker", "h1")),
    "trainings": Kind("*.safetensors", training, resumed),
    "demonstrations": Kind("**/*.*", demos, lambda folder: load_demos(folder, "h1")),
    "rows": Kind("*.parquet", rows, lambda folder: read_rows(folder / "rows.parquet")),
}


def content(value: Any) -> str:
    """A digest of everything in a value."""
    found = hashlib.blake2b(digest_size=16)

    def add(one: Any) -> None:
        if isinstance(one, np.ndarray):
            found.update(f"{one.dtype}{one.shape}".encode() + np.ascontiguousarray(one).tobytes())
        elif dataclasses.is_dataclass(one):
            add({entry.name: getattr(one, entry.name) for entry in dataclasses.fields(one)})
        elif isinstance(one, Mapping):
            for key in sorted(one):
                found.update(f"{key}:".encode())
                add(one[key])
        elif isinstance(one, list | tuple):
            found.update(b"[")
            for each in one:
                add(each)
        else:
            found.update(repr(one).encode())

    add(value)
    return found.hexdigest()


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """Bytes with a flipped bit, another byte, a lost or zeroed stretch, an end cut off, or something behind it."""
    at, length = int(random.integers(len(data))), int(random.integers(1, 200))
    changed = bytearray(data)
    match random.integers(8):
        case 0 | 1 | 2:
            changed[at] ^= 1 << int(random.integers(8))
        case 3:
            changed[at] = int(random.integers(256))
        case 4:
            changed[at : at + length] = bytes(len(changed[at : at + length]))
        case 5:
            del changed[at : at + length]
        case 6:
            del changed[at:]
        case _:
            changed += random.bytes(length)
    return bytes(changed)


def campaign(kind: Kind, count: int, seed: int, folder: Path) -> tuple[Counter[str], list[str]]:
    """How many damaged files were refused, read as whole or the same after all, and what went wrong."""
    kind.write(folder)
    whole, random = content(kind.read(folder)), np.random.default_rng(seed)
    paths = sorted(path for path in folder.glob(kind.files) if path.is_file())
    found, wrong = Counter[str](), []
    for number in range(count):
        path = paths[number % len(paths)]
        data = path.read_bytes()
        changed = damaged(data, random)
        path.write_bytes(changed)
        try:
            told = "harmless" if content(kind.read(folder)) == whole else "READ AS SOMETHING ELSE"
        except MimicbenchError as error:
            told = "refused" if "\n" not in str(error) else "SEVERAL LINES"
        except Exception:  # noqa: BLE001 whatever it is, it should not have been
            told = "TRACEBACK " + traceback.format_exc().strip().splitlines()[-1]
        found["same bytes" if changed == data else told.partition(" ")[0]] += 1
        if told.isupper() or told.startswith("TRACEBACK"):
            wrong.append(f"{path.name} number {number}: {told}")
        path.write_bytes(data)
    return found, wrong


def main() -> int:
    """0 if nothing was read silently, and nothing ended in a traceback."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=5000, help="damaged files, over all kinds")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    bad = 0
    for name, kind in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            found, wrong = campaign(kind, max(1, chosen.count // len(KINDS)), chosen.seed, Path(folder))
        print(f"{name:<16}", ", ".join(f"{what} {number}" for what, number in sorted(found.items())), flush=True)
        for line in wrong[:10]:
            print(f"    {line}")
        bad += len(wrong)
    print(f"{bad} read silently or ended in a traceback")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

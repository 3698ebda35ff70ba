"""What a tracker survives: K and who stays, in worlds that are worse than the one it is judged in."""

from collections.abc import Callable, Mapping

from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.intervals import Rate
from mimicbench.report.table import Table
from mimicbench.robots.description import Robot
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.tracker import Tracker


def cases(robot: Robot) -> dict[str, Disturbance]:
    """The worlds by name. A real H1 weighs 58 kg, the description's 51; sensors err as trackers for hardware are
    trained to bear (BeyondMimic), but for the root's velocity, which here is an estimate over time.
    """
    joints = len(robot.joints)
    # gravity, height [m], velocities of the root [m/s, rad/s], joints [rad, rad/s]
    errors = (*(0.02,) * 3, 0.01, *(0.1,) * 3, *(0.2,) * 3, *(0.01,) * joints, *(0.5,) * joints)
    return {
        "as it is": Disturbance(),
        "pushes of 0.5 m/s": Disturbance(push=0.5),
        "friction 0.6": Disturbance(friction=0.6),
        "friction 1.2": Disturbance(friction=1.2),
        "10 % lighter": Disturbance(mass=0.9),
        "10 % heavier": Disturbance(mass=1.1),
        "targets 20 ms late": Disturbance(delay=1),
        "sensor noise": Disturbance(noise={"proprio": errors}),
    }


def bench_robustness(
    tracker: Tracker, clips: ClipSet, env_config: EnvConfig, say: Callable[[str], None]
) -> dict[str, dict[str, int]]:
    """How many of the clips are followed to K, and how many robots stay to the time limit, in each world."""
    found = {}
    for name, world in cases(clips.robot).items():
        verdict = track_clips(tracker, clips, RolloutConfig(disturbance=world, settle=None), env_config).verdict
        found[name] = {"clips": len(clips), "k": int(verdict.success.sum()), "stays": int(verdict.stays.sum())}
        say(f"{clips.task.name}, {name}: K {found[name]['k']}, stays {found[name]['stays']} of {len(clips)}")
    return found


def robustness_table(found: Mapping[str, Mapping[str, Mapping[str, int]]]) -> Table:
    """K and stays by world, a pair of columns for each task."""
    worlds = list(next(iter(found.values())))
    rows = tuple(
        (world, *(Rate(of[world][what], of[world]["clips"]) for of in found.values() for what in ("k", "stays")))
        for world in worlds
    )
    return Table(
        "robustness",
        "What the tracker survives",
        ("world", *(f"{task} {what}" for task in found for what in ("K", "stays"))),
        rows,
        "From the first frames of clips on unseen objects, mean action, to the time limit. Everything else as the "
        "benchmark has it.",
    )

"""Pages of the methods, to retarget, to track, to learn, and of the tables that tell how they do."""

from dataclasses import fields

from doc_pages.words import described, field_docs, table
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.spec import ImitateConfig
from mimicbench.report.tables.registry import TABLES
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.description import Robot
from mimicbench.sensors.term import Term
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.tracker import Layout


def linked(folder: str, name: str) -> str:
    """A method's name that leads to its page."""
    return f"[`{name}`]({folder}/{name}.md)"


def retargeting_page() -> str:
    """The ways to retarget, and what a solved clip of each measures at most."""
    methods = METHODS.all()
    what = ((linked("retargeting", m.name), m.title, ", ".join(m.presets), described(METHODS, m.name)) for m in methods)
    limits = fields(methods[0].limits)
    words = field_docs(type(methods[0].limits))
    most = ((f"`{f.name}`", *(f"{getattr(m.limits, f.name):.3g}" for m in methods), words[f.name]) for f in limits)
    return (
        "# Retargeting methods\n\n`mimicbench retarget --method <name>`. "
        "The guide: [retargeting](../retargeting.md).\n\n"
        + table(("method", "in tables", "variants", "what it does"), what)
        + "\n\n## What a solved clip measures at most\n\n"
        + table(("measure", *(m.name for m in methods), "what"), most)
    )


def trackers_page(robot: Robot) -> str:
    """The trackers."""
    rows = [
        (
            linked("trackers", t.name),
            described(TRACKERS, t.name),
            t.gains,
            Layout.of(t, robot, [TASKS.get("sit-chair")]).size,
            ", ".join(f"`{o.name if isinstance(o, Term) else o}`" for o in t.observations),
        )
        for t in TRACKERS.all()
    ]
    return (
        "# Trackers\n\n`mimicbench track --tracker <name>`; their [settings](../settings/track.md). Inputs are counted "
        f"at sit-chair, for the robot `{robot.name}`; terms that a task does not have are left out.\n\n"
        + table(("tracker", "what", "gains", "inputs", "terms"), rows)
    )


def inputs_table(robot: Robot) -> str:
    """What each tracker observes at sit-chair, and which gains it drives."""
    return table(
        ("tracker", "gains", "inputs", "terms"),
        (
            (
                f"`{t.name}`",
                f"`{t.gains}`",
                Layout.of(t, robot, [TASKS.get("sit-chair")]).size,
                ", ".join(f"`{o.name if isinstance(o, Term) else o}`" for o in t.observations),
            )
            for t in TRACKERS.all()
        ),
    )


def _source_of(config: type[ImitateConfig]) -> str:
    """What a learner learns from, in words."""
    if not config.references:
        return "objects, by trying"
    return "demonstrations" if config.clones else "clips, through the tracker"


def learners_page() -> str:
    """The learners."""
    rows = (
        (
            linked("learners", learner.name),
            described(LEARNERS, learner.name),
            _source_of(learner.config),
            f"`{learner.config.tracker}`" if learner.config.tracker else "any, or none",
        )
        for learner in LEARNERS.all()
    )
    return (
        "# Learners\n\n`mimicbench imitate --learner <name>`; their [settings](../settings/imitate.md). "
        "The guide: [learners](../learners.md).\n\n"
        + table(("learner", "what", "learns from", "speaks to the tracker"), rows)
    )


def tables_page() -> str:
    """The tables of judged episodes."""
    rows = ((f"`{t.name}`", t.what, "one task" if t.per_task else "all tasks together") for t in TABLES.all())
    return (
        "# Tables\n\n`mimicbench table FILES --show <name>`, of files of episode rows. Reports have those of one task. "
        "The guide: [how the numbers are made](../numbers.md).\n\n" + table(("table", "what it shows", "of"), rows)
    )

"""Every learner keeps the same contract; clock and memory say what they should."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.benchmark.recipe import read_recipe
from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.settings import BadSetting
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.dataset import DemoFrames, EpisodeGoals, proprioception
from mimicbench.imitate.encoder import Encoder
from mimicbench.imitate.inputs import Batch
from mimicbench.imitate.learn_perception import Sights, draw_maps
from mimicbench.imitate.learned import load_learner, save_learner
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.perception import Perception, save_perception
from mimicbench.imitate.policy import VisionPolicy
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.settings.cloning import MapErrors
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig, Window
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.imitate.stored.scenery import Scenery, disturbed
from mimicbench.imitate.train import Course, train
from mimicbench.objects.families.chair import make_chair
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR

TINY = EncoderConfig(pool=4, widths=(8, 8, 8, 8), blocks=(1, 1, 1, 1))
H1 = ROBOTS.get("h1")
INPUTS = {
    "paper": InputConfig(),
    "timed": InputConfig(body="proprio", clock=True, memory=True),
    "blind": InputConfig(body="state", clock=True, memory=True, elevation=False),
    "history": InputConfig(history=3),
    "cameras": InputConfig(views=True),
}
SMALL = {
    "act": {"hidden": 32, "feedforward": 32, "heads": 2, "chunk": 5, "latent": 4, "dropout": 0.0},
    "bc": {"hidden": 64, "reduce": (8,)},
    "hit": {"hidden": 32, "heads": 2, "chunk": 5, "dropout": 0.0},
    "diffusion": {"widths": (16, 32), "groups": 4, "chunk": 8, "executes": 3, "step_embedding": 8, "sample_steps": 4},
}


def kinds():
    """Names of learners that clone, one for every kind of network."""
    clones = (LEARNERS.get(name).config for name in LEARNERS if LEARNERS.get(name).config.clones)
    return list({type(config().network): config().learner for config in reversed(list(clones))}.values())


def tiny(kind, inputs):
    """The network of a learner for the H1 at sit-chair, as small as can be."""
    network = LEARNERS.get(kind).config().network
    inputs = replace(inputs, history=max(inputs.history, network.inputs.history))
    return replace(network, inputs=inputs, encoder=TINY, **SMALL[kind]).of(H1, SIT_CHAIR)


@pytest.fixture(scope="module")
def chairs():
    return {chair.id: chair for chair in (make_chair(i) for i in range(3))}


@pytest.fixture(scope="module")
def demos(chairs):
    """Robots that glide past chairs; the action is a function of time and of where the chair is."""
    random = np.random.default_rng(0)
    lengths = [20, 25, 30, 15, 18, 22]
    state, action, qpos, qvel = [], [], [], []
    for frames in lengths:
        time = np.arange(frames)[:, None] / 50
        start, yaw = random.uniform(-1.5, 1.5, 2), random.uniform(-3, 3)
        positions = np.zeros((frames, 26))
        positions[:, :2] = start + time * random.normal(size=2)
        positions[:, 2] = 1.0
        positions[:, 3:7] = rot.from_yaw(np.full(frames, yaw))
        qpos.append(positions)
        qvel.append(random.normal(size=(frames, 25)) * 0.1)
        state.append(random.normal(size=(frames, 300)).astype(np.float32))
        action.append((np.sin(2 * time + np.arange(19)) + 0.3 * start[0]).astype(np.float32))
    actions = np.concatenate(action)
    return Demos(
        robot="h1",
        task="sit-chair",
        fps=50.0,
        joint_names=tuple(map(str, range(19))),
        starts=np.concatenate([[0], np.cumsum(lengths)]),
        state=np.concatenate(state),
        action=actions,
        executed_action=actions,
        qpos=np.concatenate(qpos),
        qvel=np.concatenate(qvel),
        object_ids=tuple(list(chairs) * 2),
        reference_ids=tuple(f"clip-{i}" for i in range(6)),
        success=np.ones(6, bool),
    )


def goals_of(demos, chairs):
    """Each demonstration was to find its chair."""
    goals = torch.tensor(np.array([SIT_CHAIR.goal.describe(chairs[name]) for name in demos.object_ids])).float()
    return EpisodeGoals(SIT_CHAIR.goal, goals)


def frames(demos, chairs, network):
    """Frames of demonstrations as a network is shown them."""
    plans = Waves(network) if network.action_size != 19 else None
    scene = [chairs[name] for name in sorted(set(demos.object_ids))]
    scenery = Scenery.of(scene, SIT_CHAIR, network.inputs)
    goals = replace(goals_of(demos, chairs), to_find=network.goal_weight > 0)
    return DemoFrames(demos, chairs, network.inputs, network.window, scenery, goals, plans)


class Waves:
    """Something to say of every frame, for learners that do not say joint targets."""

    def __init__(self, network):
        self.size = network.action_size

    def of(self, frames, steps):
        return torch.sin(0.1 * steps[..., None] + torch.arange(self.size)) + 0.01 * (steps - frames[:, None])[..., None]


CASES = [(kind, name) for kind in kinds() for name in INPUTS]


@pytest.mark.parametrize(("kind", "inputs"), CASES)
def test_learner_contract(kind, inputs, demos, chairs, tmp_path):
    config = tiny(kind, INPUTS[inputs])
    torch.manual_seed(0)
    learner = config.build()
    data = frames(demos, chairs, config)
    batch = data.batch(torch.arange(10), torch.Generator().manual_seed(0))
    history = (config.inputs.history,) if config.inputs.history > 1 else ()
    assert batch.vector.shape == (10, *history, config.inputs.size)
    assert batch.actions.shape == (10, config.window.chunk, config.action_size)
    assert (batch.picture is None) == (not config.inputs.sees)
    learner.normalize_by(data.vector(torch.arange(demos.frames)), data.samples(torch.arange(demos.frames)), data.ends())
    # the loss falls
    optimizer = torch.optim.Adam(learner.parameters(), 3e-3)
    losses = []
    for _ in range(25):
        loss = learner.loss(batch, torch.Generator().manual_seed(0))["loss"]
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.7 * losses[0]
    # every part takes part
    for part in learner.children():
        assert sum(float(p.grad.abs().sum()) for p in part.parameters() if p.grad is not None) > 0
    # using it has no randomness, and does not depend on its neighbors in the batch
    learner.eval()
    with torch.no_grad():
        plan = learner.plan(batch.vector, batch.picture)
        first = learner.predict(batch.vector, batch.picture)
        alone = learner.predict(batch.vector[3:4], None if batch.picture is None else batch.picture[3:4])
    assert first.shape == (10, config.action_size) and (plan[:, 0] == first).all()
    assert plan.shape[1] >= learner.executes
    torch.testing.assert_close(first[3:4], alone, atol=1e-5, rtol=1e-4)
    # saved and loaded, it is the same
    save_learner(tmp_path, learner, "h1")
    with torch.no_grad():
        assert (load_learner(tmp_path, H1, type(config))[0].predict(batch.vector, batch.picture) == first).all()
    with pytest.raises(BadCheckpoint, match="another robot"):
        load_learner(tmp_path, replace(H1, name="g1"), type(config))


def test_presets_have_the_published_sizes():
    def built(kind):
        network = type(LEARNERS.get(kind).config().network)()
        with torch.device("meta"):
            return network.of(H1, SIT_CHAIR).build()

    act, bc, hit, diffusion = (built(kind) for kind in ("act", "bc", "hit", "diffusion"))
    with torch.device("meta"):
        resnet = Encoder(EncoderConfig(channels=3))
    assert (len(act.decoder_layers), len(act.encoder_layers), act.config.chunk, act.config.latent) == (7, 4, 100, 32)
    assert act.inputs.size == 300 and act.map_encoder.config.side == 4
    # ResNet-18 without its classifier has 11.18 million weights for three channels
    assert sum(p.numel() for p in resnet.parameters()) == pytest.approx(11.18e6, rel=0.002)
    assert bc.mlp[0].in_features == 300 + 32 * 16
    # 47 numbers in each of two frames
    assert (hit.config.chunk, len(hit.blocks), hit.head.in_features, hit.head.out_features) == (50, 6, 512, 94)
    assert hit.blocks[0].feedforward[0].out_features == 2048 and hit.config.feature_weight == 0.005
    assert diffusion.config.widths == (512, 1024, 2048) and diffusion.config.step_embedding == 128
    assert (diffusion.inputs.history, diffusion.config.chunk, diffusion.executes) == (2, 16, 8)
    # FiLM is told the amount of noise, two states and the features of two maps
    assert diffusion.unet.down[0][0].film[1].in_features == 128 + 2 * (300 + 512)


def test_loss_ignores_what_comes_after_the_end(demos, chairs):
    config = tiny("act", INPUTS["blind"])
    learner = config.build().eval()
    data = frames(demos, chairs, config)
    batch = data.batch(torch.tensor([18, 19]))
    assert batch.pad.tolist() == [[False, False, True, True, True], [False, True, True, True, True]]
    other = Batch(batch.vector, None, torch.where(batch.pad[..., None], 9.0, batch.actions), batch.pad)
    losses = [float(learner.loss(b, torch.Generator().manual_seed(1))["loss"].detach()) for b in (batch, other)]
    assert losses[0] == losses[1]


def test_all_decoder_layers_learn(demos, chairs):
    # the original reads the first layer's output only
    config = replace(tiny("act", INPUTS["blind"]), decoder_layers=3)
    learner = config.build()
    learner.loss(frames(demos, chairs, config).batch(torch.arange(4)))["l1"].backward()
    assert all(float(layer.feedforward[0].weight.grad.abs().sum()) > 0 for layer in learner.decoder_layers)


def test_clock_leaves_the_last_action_out():
    state = torch.arange(300.0)[None]
    proprio, time = torch.zeros(1, 48), torch.zeros(1)
    inputs = InputConfig(clock=True).on(H1)
    vector = inputs.vector(state, proprio, time, None)
    assert vector.shape == (1, inputs.size) == (1, 281 + 13)
    assert not set(range(278, 297)) & set(vector[0, :281].int().tolist())
    assert InputConfig(body="proprio", clock=True, memory=True).of(H1, SIT_CHAIR).size == 48 + 13 + 10


def test_the_last_action_can_be_left_out():
    inputs = InputConfig(last_action=False).on(H1)
    vector = inputs.vector(torch.arange(300.0)[None], torch.zeros(1, 48), torch.zeros(1), None)
    assert vector[0].int().tolist() == [*range(278), *range(297, 300)] and inputs.size == 281
    assert InputConfig().on(H1).size == 300


def test_a_quick_encoder_reads_patches_one_by_one():
    torch.manual_seed(0)
    encoder, maps = Encoder(EncoderConfig.quick()), torch.zeros(1, 1, 128, 128)
    assert encoder(maps).shape == (1, 64, encoder.config.side, encoder.config.side) == (1, 64, 4, 4)
    changed = maps.clone()
    changed[0, 0, 8:16, 120:] = 1.0
    differs = (encoder.stem(changed) != encoder.stem(maps)).any(1)[0].nonzero().tolist()
    assert differs == [[1, 15]]
    assert sum(p.numel() for p in encoder.parameters()) == 32 * 65 + 48 * (9 * 32 + 1) + 64 * (9 * 48 + 1)


def test_clock():
    found = clock_features(torch.tensor([0.0, 3.6]))
    assert found[0].tolist() == [0.0] * 7 + [1.0] * 6
    # 3.6 s: whole turns of the first four hands, half a turn and a quarter turn of the last two
    torch.testing.assert_close(found[1], torch.tensor([0.25, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, -1, 0]), atol=1e-5, rtol=0)


def test_proprioception_of_a_turned_robot():
    qpos, qvel = np.zeros((1, 26)), np.zeros((1, 25))
    qpos[0, 2:7] = [0.9, *rot.from_yaw(np.array(math.pi / 2))]
    qpos[0, 7:], qvel[0, :3], qvel[0, 3:6] = np.arange(19), (0, 2, 0), (1, 2, 3)
    found = proprioception(qpos, qvel, 19)[0]
    # it moves along world y, which is straight ahead
    np.testing.assert_allclose(found[:10], [0, 0, -1, 0.9, 2, 0, 0, 1, 2, 3], atol=1e-6)
    assert found.shape == (48,)


SHORT = Course(steps=6, batch=8, log_steps=2, save_every=1e9, average=0.9, threads=1)


@pytest.mark.parametrize("kind", kinds())
def test_training_is_deterministic_and_survives_a_kill(kind, demos, chairs, tmp_path, monkeypatch):
    config = tiny(kind, INPUTS["timed"])
    config = replace(config, **({"dropout": 0.1} if hasattr(config, "dropout") else {}))
    data = frames(demos, chairs, config)
    whole = train(config, data, SHORT, tmp_path / "whole", quiet=True).state_dict()
    # stopped after three batches, then taken up; lines written after the checkpoint are forgotten
    train(config, data, replace(SHORT, steps=3, schedule="constant"), tmp_path / "constant", quiet=True)
    said = {"gains": "paper"}
    train(config, data, replace(SHORT, schedule="constant"), tmp_path / "once", quiet=True, notes=said)
    with open(tmp_path / "constant/metrics.jsonl", "a") as stream:
        stream.write('{"step": 4, "loss": 0}\n{"st')
    torch.set_num_threads(2)  # as in another program, which has done other things before
    resumed = train(config, data, replace(SHORT, schedule="constant"), tmp_path / "constant", quiet=True).state_dict()
    assert torch.get_num_threads() == 1
    learner, notes = load_learner(tmp_path / "once", H1, type(config))
    once = learner.state_dict()
    assert notes["gains"] == "paper" and notes["steps"] == SHORT.steps, "a checkpoint can be used before it is finished"
    assert all((once[name] == resumed[name]).all() for name in once)
    steps = [json.loads(line)["step"] for line in (tmp_path / "constant/metrics.jsonl").read_text().splitlines()]
    assert steps == [2, 3, 4, 6, 6]
    monkeypatch.setattr("mimicbench.imitate.train.batches_ahead", lambda device: 3)  # however many are made at a time
    again = train(config, data, SHORT, tmp_path / "again", quiet=True).state_dict()
    assert all((whole[name] == again[name]).all() for name in whole)
    # running a finished training again does nothing
    before = (tmp_path / "again/metrics.jsonl").read_text()
    train(config, data, SHORT, tmp_path / "again", quiet=True)
    assert (tmp_path / "again/metrics.jsonl").read_text() == before


def test_training_refuses(demos, chairs, tmp_path):
    config = tiny("bc", INPUTS["blind"])
    data = frames(demos, chairs, config)
    train(config, data, SHORT, tmp_path, quiet=True)
    with pytest.raises(MimicbenchError, match="another train"):
        train(config, data, replace(SHORT, seed=1), tmp_path, quiet=True)
    with pytest.raises(MimicbenchError, match="smaller learning rate"):
        train(config, data, replace(SHORT, learning_rate=1e30, clip=0.0, warmup=0.0), tmp_path / "wild", quiet=True)
    assert not (tmp_path / "wild/model.safetensors").exists()
    with pytest.raises(BadFile, match="is missing"):
        DemoFrames(demos, {}, config.inputs, Window())


SIGHT = PerceptionConfig(
    heights=(1.0, 1.0),
    steps=150,
    maps=256,
    seen=0.25,
    batch=32,
    widths=(8, 16, 16),
    hidden=32,
    dropout=0.0,
    distance=(1.5, 2.0),
)


def test_policy_sees_the_shape_and_nothing_else(demos, chairs, tmp_path):
    config = tiny("act", INPUTS["timed"])
    save_learner(tmp_path / "act", config.build(), "h1")
    robot, task = H1, SIT_CHAIR
    with pytest.raises(BadFile, match="perception"):
        load_policy(tmp_path / "act", robot, task)
    save_perception(tmp_path / "perception", Perception(SIGHT, SIT_CHAIR), "h1")
    policy = load_policy(tmp_path / "act", robot, task)
    drawn = draw_maps(SIGHT, SIT_CHAIR, Sights.of(SIT_CHAIR, list(chairs.values())), 4, "policy", seen=0.0)
    maps, height = drawn.maps, drawn.root_height
    proprio = torch.randn(4, 48)
    proprio[:, 3] = height

    def senses(elevation):
        return Observations(
            {
                "proprio": proprio,
                "time": torch.full((4, 1), 0.5),
                "odometry": torch.zeros(4, 3),
                "elevation": elevation,
                "heightmap": elevation,
            }
        )

    policy.reset(torch.arange(4), senses(maps))
    first = policy.act(senses(maps))
    assert first.shape == (4, 19)
    assert (policy.act(senses(maps)) == first).all()
    # only the robot that begins anew forgets what it saw
    policy.reset(torch.tensor([2]), senses(maps.flip(1)))
    second = policy.act(senses(maps))
    assert [bool((first[i] == second[i]).all()) for i in range(4)] == [True, True, False, True]
    assert isinstance(policy, VisionPolicy)


@pytest.mark.parametrize("name", LEARNERS.names())
def test_every_learner_is_whole(name):
    """Its configuration names it, is a recipe's part with defaults of its own, and says what it needs."""
    spec = LEARNERS.get(name)
    config = spec.config()
    assert config.learner == name and type(config).chosen({"learner": name}) is spec.config
    assert spec.config.tracker in (None, "residual") and isinstance(spec.config.clones, bool)
    assert spec.config.references or (config.gains and not spec.config.clones and spec.config.tracker is None)


def test_maps_are_less_than_perfect_as_they_are_told_to_be():
    """Each error by hand, on maps that slope so that every cell is another one."""
    slope = torch.arange(128.0).repeat(6, 128, 1) / 128 + torch.arange(128.0)[:, None] - 1.0
    heights = torch.linspace(0.503, 1.003, 6)

    def wrong(**errors):
        return disturbed(slope, heights, MapErrors(**errors), torch.Generator().manual_seed(0))

    assert wrong() is slope
    assert (wrong(cells=0.02) - slope).std() == pytest.approx(0.02, rel=0.02)
    offsets = (wrong(height=0.1) - slope).flatten(1)
    assert offsets.std(1).max() < 1e-4 and 0.03 < offsets.mean(1).std() < 0.3, "all of a map together"
    gone = wrong(missing=0.25) != slope
    assert gone.float().mean() == pytest.approx(0.25, abs=0.03)
    assert (wrong(missing=1.0) == -heights[:, None, None]).all(), "at floor level"
    squares = gone.unflatten(1, (16, 8)).unflatten(3, (16, 8)).float().mean((2, 4))
    assert set(squares.unique().tolist()) <= {0.0, 1.0}
    shifted = wrong(shift=4.0)
    for i in range(6):
        one, other = (torch.nonzero(shifted[i] == slope[i, at, at])[0] - at for at in (60, 66))
        assert torch.equal(one, other) and one.abs().max() < 20, "as one"
    assert not (shifted == slope).flatten(1).all(1).any()


def test_late_maps_are_of_where_the_robot_was(demos, chairs):
    config = tiny("bc", INPUTS["paper"])
    scene = [chairs[name] for name in sorted(set(demos.object_ids))]
    late = DemoFrames(
        demos, chairs, config.inputs, config.window, Scenery.of(scene, SIT_CHAIR, config.inputs, MapErrors(late=3))
    )
    frames = torch.tensor([0, 1, *[9] * 24])
    seen = late.pictures(frames, torch.Generator().manual_seed(0))
    earlier = [
        {frame for frame in range(10) if torch.equal(picture, late.pictures(torch.tensor([frame]))[0])}
        for picture in seen
    ]
    assert earlier[0] == {0} and earlier[1] <= {0, 1}, "not before the episode"
    assert set.union(*earlier[2:]) == {6, 7, 8, 9}
    assert torch.equal(late.pictures(frames)[2], late.pictures(frames)[3]), "no errors where it is judged"


def test_only_who_sees_maps_is_told_of_their_errors():
    with pytest.raises(BadSetting, match="does not see"):
        read_recipe({"imitate": {"learner": "bc-clock", "train": {"maps": {"missing": 0.1}}}})
    with pytest.raises(BadSetting, match="does not see"):
        read_recipe(
            {"imitate": {"learner": "bc", "network": {"inputs": {"views": True}}, "train": {"maps": {"late": 2}}}}
        )


def test_checkpoints_that_do_not_say_what_made_their_maps_saw_by_straight_rays(tmp_path):
    config = tiny("bc", INPUTS["paper"])
    save_learner(tmp_path, config.build(), "h1")
    assert load_learner(tmp_path, H1, type(config))[0].inputs.cameras
    told = json.loads((tmp_path / "config.json").read_text())
    del told["config"]["inputs"]["cameras"], told["digest"]
    (tmp_path / "config.json").write_text(json.dumps(told))
    assert load_learner(tmp_path, H1, type(config))[0].inputs.map_term == "heightmap"


def test_nothing_is_learned_from_the_frames_that_judge(demos, chairs, tmp_path):
    config = tiny("bc", INPUTS["blind"])
    goals = goals_of(demos, chairs)
    data = DemoFrames(demos, chairs, config.inputs, config.window, validation=0.5, goals=goals)
    held, learned = set(data.validation_frames.tolist()), set(data.train_frames.tolist())
    assert held and learned and not held & learned and len(held) + len(learned) == demos.frames
    episodes = {int(data.episode[frame]) for frame in held}
    assert not episodes & {int(data.episode[frame]) for frame in learned}, "whole episodes are kept apart"
    data.action = data.action.clone()  # the demonstrations are of other tests, too
    data.action[data.validation_frames] = math.nan  # whoever learned from one would notice
    trained = train(config, data, Course(steps=20, batch=32, device="cpu"), tmp_path, quiet=True)
    assert all(torch.isfinite(value).all() for value in trained.state_dict().values())


def test_of_what_a_learner_drove_a_batch_has_the_part_that_is_asked_for(demos, chairs):
    blind = tiny("bc", INPUTS["blind"])
    all_shown = frames(demos, chairs, blind)
    chosen = int(all_shown.episode[all_shown.train_frames[0]])
    data = frames(replace(demos, success=np.arange(6) != chosen), chairs, blind)

    def drawn(data, part):
        frames = data.draw(400, 0.0, part, 0.0, torch.Generator().manual_seed(0))
        assert len(frames) == 400 and set(frames.tolist()) <= set(data.train_frames.tolist())
        return float((data.episode[frames] == chosen).double().mean())

    share = float((data.episode[data.train_frames] == chosen).double().mean())
    assert drawn(data, 0.5) == 0.5 and drawn(data, 1.0) == 1.0
    assert drawn(data, 0.0) == pytest.approx(share, abs=0.07), "as many as there are"
    assert drawn(all_shown, 0.5) != 0.5, "there are none"


def test_windows_end_where_episodes_do(demos, chairs):
    """Two frames are seen, and the actions of eight, one of them past; beyond either end there is but the end."""
    data = frames(demos, chairs, tiny("diffusion", INPUTS["blind"]))
    assert demos.starts[1] == 20
    batch, single = data.batch(torch.tensor([0, 1, 19, 20])), data.vector(torch.arange(demos.frames))
    assert (batch.vector[:, 0] == single[[0, 0, 18, 20]]).all() and (batch.vector[:, 1] == single[[0, 1, 19, 20]]).all()
    assert (batch.actions[1] == data.action[:8]).all()
    assert (batch.actions[2] == data.action[[18, *[19] * 7]]).all() and batch.pad[2].tolist() == [False] * 2 + [
        True
    ] * 6
    assert (batch.actions[3] == data.action[[20, 20, 21, 22, 23, 24, 25, 26]]).all() and not batch.pad[3].any()


def test_what_is_foreseen_is_the_map_after_the_chunk(demos, chairs):
    config = tiny("hit", INPUTS["paper"])
    batch = frames(demos, chairs, config).batch(torch.tensor([3, 17]))
    data = frames(demos, chairs, config)
    assert config.window.chunk == 5 and batch.ahead.shape == batch.picture.shape
    assert (batch.ahead == data.pictures(torch.tensor([8, 19]))).all(), "none lies after the end"


def test_a_plan_is_carried_out_before_the_next():
    """Three frames of it, and by each robot from its own start on."""
    config = tiny("diffusion", InputConfig(body="proprio", clock=True, elevation=False))
    torch.manual_seed(0)
    policy, random = VisionPolicy(config.build()), torch.Generator().manual_seed(0)
    seen = [torch.randn(2, 48, generator=random) for _ in range(5)]

    def senses(at):
        time = torch.full((2, 1), 0.02 * at)
        return Observations({"proprio": seen[at], "time": time, "odometry": torch.zeros(2, 3)})

    def planned(*frames):
        vectors = [config.inputs.vector(seen[at], seen[at], torch.full((2,), 0.02 * at), None) for at in frames]
        with torch.no_grad():
            return policy.learner.plan(torch.stack(vectors, 1), None)

    policy.reset(torch.arange(2), senses(0))
    targets = [policy.act(senses(at)) for at in range(4)]
    first, second = planned(0, 0), planned(2, 3)
    for at in range(3):
        torch.testing.assert_close(targets[at], first[:, at])
    torch.testing.assert_close(targets[3], second[:, 0])
    policy.reset(torch.tensor([1]), senses(4))
    last = policy.act(senses(4))
    torch.testing.assert_close(last[0], second[0, 1])
    torch.testing.assert_close(last[1], planned(4, 4)[1, 0])


@pytest.mark.parametrize("kind", kinds())
def test_no_learner_assumes_the_joints_of_one_robot(kind):
    short = replace(H1, name="short", joints=H1.joints[:-2], rest_pose=H1.rest_pose[:-2])
    for inputs in INPUTS.values():
        config = replace(tiny(kind, inputs), inputs=inputs).of(short, SIT_CHAIR)
        body = {"state": 3 + 2 * 17 + 12 * 20 + (0 if inputs.clock else 17), "proprio": 10 + 2 * 17}[inputs.body]
        assert config.inputs.size == body + (13 if inputs.clock else 0) + (10 if inputs.memory else 0)
        assert config.action_size in (17, 2 * (2 * 17 + 9))
        assert config.build().action_mean.shape[-1] == config.action_size

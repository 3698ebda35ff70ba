"""Policies as ONNX files: ours decide there as they do here, and other people's are judged or refused in a sentence."""

import builtins
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import mimicbench
from mimicbench.benchmark.who import who_of
from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.learners.ppo import PPOImitation
from mimicbench.policies.loading import load_policy
from mimicbench.tasks.registry import TASKS
from test_hit import saved
from test_imitate import INPUTS, tiny
from test_policies import H1, SIT_CHAIR, clip_set

onnx = pytest.importorskip("onnx", reason="the extra `onnx` is not installed")
pytest.importorskip("onnxruntime", reason="the extra `onnx` is not installed")
pytest.importorskip("onnxscript", reason="the extra `onnx` is not installed")
SHIPPED = Path(mimicbench.__path__[0]) / "checkpoints" / "sit-chair"


def untrained(kind, folder):
    """A checkpoint of a learner that has learned nothing."""
    if kind == "hit":
        return saved(folder, SIT_CHAIR, "residual")
    torch.manual_seed(0)
    if kind == "ppo":
        save_learner(folder / "policy", PPOImitation().network.of(H1, SIT_CHAIR).build(), "h1")
        return folder / "policy"
    save_learner(folder / "policy", tiny(kind, INPUTS["paper"]).build(), "h1")
    return folder / "policy"


@pytest.mark.parametrize("kind", ["bc", "act", "hit", "diffusion", "ppo", "bc-clock"])
def test_exported_policies_decide_as_the_originals(kind, tmp_path):
    """Over episodes, whatever they remember; bc-clock has eyes, the planner of the next test has none."""
    from mimicbench.policies.export import TOLERANCE, export_policy

    folder = SHIPPED / kind if (SHIPPED / kind).exists() and kind not in ("bc", "act") else untrained(kind, tmp_path)
    found = export_policy(folder, H1, SIT_CHAIR, tmp_path / "policy.onnx")
    assert found["difference"] < TOLERANCE and "time" in found["observations"]
    clips, one = clip_set(2, 0.4), EnvConfig(workers=1)
    policies = [load_policy(path, H1, SIT_CHAIR) for path in (folder, tmp_path / "policy.onnx")]
    assert policies[0].gains == policies[1].gains
    runs = [run_policy(policy, clips, record=[0, 1], env_config=one)[0] for policy in policies]
    assert not runs[0].errors and not runs[1].errors
    for i in range(2):
        np.testing.assert_allclose(runs[0].recordings[i], runs[1].recordings[i], atol=5e-3)
    with pytest.raises(BadFile, match="policy of task 'sit-chair'"):
        load_policy(tmp_path / "policy.onnx", H1, replace(SIT_CHAIR, name="stand"))


def test_who_is_told_places_is_checked_with_numbers_and_nan_is_no_agreement(tmp_path):
    from mimicbench.policies.export import TOLERANCE, _difference, export_policy

    touch, folder = TASKS.get("touch-points"), SHIPPED.parent / "touch-points" / "planner"
    found = export_policy(folder, H1, touch, tmp_path / "policy.onnx")
    assert 0 < found["difference"] < TOLERANCE, "sums round differently"
    broken = load_policy(folder, H1, touch)
    with torch.no_grad():
        next(iter(broken.networks()[0].parameters())).fill_(torch.nan)
    assert _difference(broken, tmp_path / "policy.onnx", H1, touch) == np.inf


@pytest.mark.parametrize("wrong", [lambda *given: 1.0, lambda *given: 1 / 0])
def test_what_is_not_the_policy_takes_no_files_place(wrong, tmp_path, monkeypatch):
    from mimicbench.policies import export

    path = tmp_path / "policy.onnx"
    path.write_bytes(b"an earlier one")
    monkeypatch.setattr(export, "_difference", wrong)
    with pytest.raises((MimicbenchError, ZeroDivisionError)):
        export.export_policy(untrained("bc", tmp_path / "bc"), H1, SIT_CHAIR, path)
    assert path.read_bytes() == b"an earlier one" and [one.name for one in tmp_path.glob("*.onnx")] == [path.name]
    assert not list(tmp_path.glob(".*"))


def made(path, terms=("proprio",), sizes=((48,),), joints=19, **notes):
    """A policy of somebody else: the joint angles among what is measured, as they are."""
    helper, kinds = onnx.helper, onnx.TensorProto
    inputs = [helper.make_tensor_value_info(f"in{i}", kinds.FLOAT, ["n", *size]) for i, size in enumerate(sizes)]
    ends = [
        onnx.numpy_helper.from_array(np.array([at]), name) for at, name in ((10, "a"), (10 + joints, "b"), (1, "x"))
    ]
    node = helper.make_node("Slice", ["in0", "a", "b", "x"], ["target"])
    output = helper.make_tensor_value_info("target", kinds.FLOAT, ["n", joints])
    graph = helper.make_graph([node], "policy", inputs, [output], ends)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {"observations": ", ".join(terms), "gains": "improved", **notes})
    onnx.save(model, str(path))
    return path


def test_a_file_of_somebody_else_is_judged(tmp_path):
    policy = load_policy(made(tmp_path / "mine.onnx"), H1, SIT_CHAIR)
    assert policy.observations == ("proprio",) and policy.gains == "improved"
    (run,) = run_policy(policy, clip_set(2, 0.2), env_config=EnvConfig(workers=1))
    assert not run.errors and run.verdict.steps.tolist() == [10, 10]
    import making
    from mimicbench.benchmark.graph import start

    who = who_of(start(making.small(), tmp_path, making.QUIET), str(tmp_path / "mine.onnx"))
    assert who.name == "mine" and set(who.digests) == {"program"} and not who.is_program
    apart = tmp_path / "apart.onnx"
    model = onnx.load(str(tmp_path / "mine.onnx"))
    onnx.save(model, str(apart), save_as_external_data=True, location="weights.bin", size_threshold=0)
    assert (tmp_path / "weights.bin").exists() and replace(who, folder=apart).is_program, "nothing tells what it reads"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"terms": ("smell",)}, "unknown observation 'smell'"),
        ({"terms": ("root_pose",), "sizes": ((7,),)}, "no robot can sense"),
        ({"terms": ("targets",), "sizes": ((2, 3),)}, "observes 'targets', which sit-chair does not have"),
        ({"sizes": ((40,),)}, r"'in0' stands for observation 'proprio' and is n x 40 .* has to be N x 48"),
        ({"terms": ("proprio", "time")}, "has 1 inputs and 1 outputs, but names 2 observations"),
        ({"terms": ("proprio",), "sizes": ((48,), (3,))}, "has 2 inputs and 1 outputs, but names 1 observations"),
        ({"joints": 17}, "'target' stands for the joint targets and is n x 17"),
        ({"gains": "none"}, "unknown gains 'none'"),
        ({"gains": ""}, "put one of .*improved.* into its metadata `gains`"),
        ({"robot": "g1"}, "policy of robot 'g1', not of 'h1'"),
    ],
)
def test_files_that_are_no_policies_are_refused(change, told, tmp_path):
    with pytest.raises((MimicbenchError, UnknownName), match=told):
        load_policy(made(tmp_path / "odd.onnx", **change), H1, SIT_CHAIR)


def test_inputs_of_one_robot_beside_inputs_of_many(tmp_path):
    """Where any input is of one robot, robots are asked for one by one; what is carried has a fixed size."""
    path = made(tmp_path / "mixed.onnx", ("proprio", "time"), ((48,), (1,)))
    model = onnx.load(str(path))
    model.graph.input[1].type.tensor_type.shape.dim[0].dim_value = 1
    onnx.save(model, str(path))
    (run,) = run_policy(load_policy(path, H1, SIT_CHAIR), clip_set(2, 0.1), env_config=EnvConfig(workers=1))
    assert not run.errors
    model.graph.input[1].type.tensor_type.shape.dim[1].dim_param = "k"
    model.graph.node.append(onnx.helper.make_node("Identity", ["in1"], ["after"]))
    model.graph.output.append(onnx.helper.make_tensor_value_info("after", onnx.TensorProto.FLOAT, [1, "k"]))
    onnx.helper.set_model_props(model, {"observations": "proprio", "gains": "improved", "carried": "in1"})
    onnx.save(model, str(path))
    with pytest.raises(MimicbenchError, match="is 1 x k of .* has to be N x a fixed size of"):
        load_policy(path, H1, SIT_CHAIR)


def test_files_that_are_no_onnx(tmp_path):
    with pytest.raises(BadFile, match="does not exist"):
        load_policy(tmp_path / "none.onnx", H1, SIT_CHAIR)
    (tmp_path / "noise.onnx").write_bytes(b"\x08\x07" * 50)
    with pytest.raises(BadFile, match="cannot be read as ONNX"):
        load_policy(tmp_path / "noise.onnx", H1, SIT_CHAIR)
    model = onnx.load(str(made(tmp_path / "mute.onnx")))
    del model.metadata_props[:]
    onnx.save(model, str(tmp_path / "mute.onnx"))
    with pytest.raises(BadFile, match="does not say what it observes"):
        load_policy(tmp_path / "mute.onnx", H1, SIT_CHAIR)


def test_who_has_no_such_form_is_told_who_has(tmp_path):
    """The kinds that say so are those that the tests above export."""
    from mimicbench.policies.export import export_policy

    with pytest.raises(MimicbenchError, match="one of these kinds: act, bc, diffusion, hit, planner, ppo$"):
        export_policy(SHIPPED / "online", H1, SIT_CHAIR, tmp_path / "out.onnx")
    assert not list(tmp_path.iterdir())


def test_who_lacks_the_extra_is_told(tmp_path, monkeypatch):
    """As if onnxruntime were not installed."""
    path, real = made(tmp_path / "mine.onnx"), builtins.__import__

    def without(name, *rest):
        if name.startswith("onnx"):
            raise ImportError(name=name)
        return real(name, *rest)

    from mimicbench.policies.export import export_policy

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MimicbenchError, match=r"pip install 'mimicbench\[onnx\]'"):
        load_policy(path, H1, SIT_CHAIR)
    with pytest.raises(MimicbenchError, match=r"pip install 'mimicbench\[onnx\]'"):
        export_policy(SHIPPED / "bc", H1, SIT_CHAIR, tmp_path / "out.onnx")

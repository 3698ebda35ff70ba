"""Muon beside Adam: steps by hand, a learning rate for each model, and states that can be taken up again."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core.training import OptimizerState, TorchRandom
from mimicbench.track.learning.muon import MuonAndAdam
from mimicbench.track.learning.ppo import PPOLearner
from mimicbench.track.network import Blueprint, MLPConfig
from tracked import TINY

MUON = replace(TINY, optimizer="muon")
SMALL = Blueprint(MLPConfig(MUON.hidden), 6)


def test_its_first_step_by_hand():
    layer = torch.nn.Linear(4, 4)
    before = [parameter.detach().clone() for parameter in layer.parameters()]
    optimizer = MuonAndAdam((layer,), 0.01)
    layer.weight.grad, layer.bias.grad = torch.diag(torch.tensor([4.0, 2.0, 1.0, 0.5])), torch.tensor([3.0, -2, 1, 0])
    optimizer.step()
    weight, bias = ((new.detach() - old) for new, old in zip(layer.parameters(), before, strict=True))
    # a diagonal gradient is made orthogonal: singular values near 1, times 0.2 sqrt(4) times the rate
    moved = -np.diag(weight) / (0.01 * 0.4)
    assert (moved > 0.5).all() and (moved < 1.5).all(), "four numbers 8 times apart move alike"
    np.testing.assert_allclose(weight - torch.diag(torch.diag(weight)), 0.0, atol=1e-4)
    np.testing.assert_allclose(bias, [-0.01, 0.01, -0.01, 0.0], atol=1e-6, err_msg="Adam's first step is the rate")


def test_its_state_is_taken_up():
    torch.manual_seed(0)

    def gradients(layer, seed):
        random = torch.Generator().manual_seed(seed)
        for parameter in layer.parameters():
            parameter.grad = torch.randn(parameter.shape, generator=random)

    first, second = torch.nn.Linear(3, 5), torch.nn.Linear(3, 5)
    ours, theirs = MuonAndAdam((first,), 0.01), MuonAndAdam((second,), 0.02)
    for seed in range(3):
        gradients(first, seed)
        ours.step()
    second.load_state_dict(first.state_dict())
    saved = {name: value.clone() for name, value in OptimizerState(ours).state_tensors().items()}
    OptimizerState(theirs).load_state_tensors(saved)
    assert len(OptimizerState(theirs).state_tensors()) == 1 + 3 + 1, "one moment of Muon, three of Adam, the rates"
    for layer, optimizer in ((first, ours), (second, theirs)):
        gradients(layer, 7)
        optimizer.step()
    for mine, other in zip(first.parameters(), second.parameters(), strict=True):
        assert torch.equal(mine, other)


def collect(learner, random):
    """One round of made-up experience, and the update on it."""
    obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
    for _ in range(MUON.steps):
        action = learner.act(obs)
        reward, done = action.pow(2).sum(-1).neg(), torch.tensor(random.random(4) < 0.2)
        obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
        learner.record(obs, reward, done, done & False)
    return learner.update(obs)


@pytest.mark.parametrize("critic_rate", [1e-3, None])
def test_learning_with_muon_is_taken_up_as_if_it_had_never_stopped(critic_rate):
    torch.manual_seed(0)
    config = replace(MUON, critic_rate=critic_rate)
    first, second = PPOLearner(SMALL, 2, 4, config), PPOLearner(SMALL, 2, 4, config)
    collect(first, np.random.default_rng(0))
    saved, random = first.state_tensors(), TorchRandom().state_tensors()
    losses = collect(first, np.random.default_rng(1))
    second.load_state_tensors(saved)
    TorchRandom().load_state_tensors(random)
    assert collect(second, np.random.default_rng(1)) == losses
    for name, value in first.state_tensors().items():
        np.testing.assert_array_equal(second.state_tensors()[name], value, err_msg=name)
    rates = [group["lr"] for group in first.ppo.optimizer.param_groups]
    assert rates[:2] == [losses["learning_rate"]] * 2
    assert rates[2:] == [critic_rate or losses["learning_rate"]] * 2

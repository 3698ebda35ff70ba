"""Diffusion Policy (Chi et al. 2023) with a convolutional network, as the paper compares it (appendix B): actions of
the next frames are recovered from noise, under the condition of what was seen in the last ones.

Training: a chunk a_0 of actions, scaled to -1..1, is mixed with noise e by a random amount of T = 100 (Ho et al. 2020):

    a_k = sqrt(A_k) a_0 + sqrt(1 - A_k) e,    loss = |e - network(a_k, k, seen)|^2

where A_k falls from 1 to 0 along a squared cosine (Nichol and Dhariwal 2021). The network is a U-Net over time:
residual blocks of two convolutions, whose channels are scaled and shifted (FiLM) by k and by what was seen.

Use: noise is turned back in few steps, without adding any (DDIM, Song et al. 2021), with x_0 kept within -1..1:

    x_0 = (a_k - sqrt(1 - A_k) e) / sqrt(A_k),    a_j = sqrt(A_j) x_0 + sqrt(1 - A_j) e,    e = network(a_k, k, seen)

Of 16 frames, the first of which is the first one seen, 8 are carried out from the present on; then it looks again.

Three things differ from the original program on purpose. Its noise is drawn anew for every prediction; here it is drawn
once and kept with the weights, so that the policy is a function of what it sees, and one prediction goes on as the last
one began. The state has mean 0 and deviation 1 instead of the range -1..1. And maps are not cropped at random: where a
cell is tells where the object is.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.encoder import Encoder
from mimicbench.imitate.inputs import Batch, Learner
from mimicbench.imitate.learners.diffusion import DiffusionConfig


class Diffusion(Learner):
    """Maps and states of the last frames, and noise -> actions."""

    kind = "diffusion"

    def __init__(self, config: DiffusionConfig) -> None:
        super().__init__(config.inputs, (config.action_size,))
        self.config, self.executes = config, config.executes
        seen = config.inputs.size
        if config.inputs.sees:
            self.map_encoder = Encoder(replace(config.encoder, channels=config.inputs.channels))
            seen += config.encoder.widths[-1]
        self.unet = _UNet(config, seen * config.inputs.history)
        self.register_buffer("kept", _kept(config.noise_steps), persistent=False)
        # what sampling begins with
        self.register_buffer("noise", torch.randn(config.chunk, config.action_size))

    def normalize_by(self, vector: Tensor, actions: Tensor, ends: Tensor) -> None:
        """Input vectors (M, size) as usual; actions (M, A) by the range (2, A) of all, so that they fill -1..1."""
        super().normalize_by(vector, actions, ends)
        low, high = ends
        self.action_mean.copy_((high + low) / 2)
        self.action_std.copy_(((high - low) / 2).clamp(min=1e-2))

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """Mean squared error of the noise, in all frames: after the end the last action is to be held."""
        actions = self.normalized_actions(batch.actions)
        place = {"generator": generator, "device": actions.device}
        noise = torch.randn(actions.shape, **place)
        step = torch.randint(self.config.noise_steps, (len(actions),), **place)
        kept = self.get_buffer("kept")[step][:, None, None]
        mixed = kept.sqrt() * actions + (1 - kept).sqrt() * noise
        return {"loss": functional.mse_loss(self.unet(mixed, step, self._seen(batch.vector, batch.picture)), noise)}

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The actions (N, chunk - history + 1, A) [rad] from the present on."""
        seen, kept = self._seen(vector, picture), self.get_buffer("kept")
        actions = self.get_buffer("noise").expand(len(seen), -1, -1)
        # from pure noise, which is the last level, to the first
        levels = torch.linspace(self.config.noise_steps - 1, 0, self.config.sample_steps).round().long().tolist()
        for number, following in zip(levels, [*levels[1:], None], strict=True):
            step = torch.full((len(seen),), number, device=seen.device)
            noise = self.unet(actions, step, seen)
            now, then = kept[number], torch.ones_like(kept[0]) if following is None else kept[following]
            clean = ((actions - (1 - now).sqrt() * noise) / now.sqrt()).clamp(-1, 1)
            actions = then.sqrt() * clean + (1 - then).sqrt() * noise
        return (actions * self.action_std + self.action_mean)[:, self.inputs.history - 1 :]

    def _seen(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """(N, history * features) of vectors (N, [history,] size) and maps (N, [history,] channels, cells, cells)."""
        parts = [self.normalized_input(vector)]
        if self.inputs.sees:
            if picture is None:
                raise ValueError("this learner sees pictures; give it some")
            frames = picture.reshape(-1, *picture.shape[-3:])
            features = self.map_encoder(self.normalized_map(frames)).mean((-1, -2))
            parts.append(features.reshape(len(vector), -1))
        return torch.cat(parts, -1)


def _kept(steps: int) -> Tensor:
    """(T,) A_k: the share of the variance that is left of the actions, by a squared cosine."""

    def share(time: float) -> float:
        return math.cos((time + 0.008) / 1.008 * math.pi / 2) ** 2

    lost = [min(1 - share((k + 1) / steps) / share(k / steps), 0.999) for k in range(steps)]
    return torch.cumprod(1 - torch.tensor(lost, dtype=torch.float64), 0).float()


class _UNet(nn.Module):
    """Noisy actions (N, chunk, A), amounts of noise (N,) and what is seen (N, S) -> the noise (N, chunk, A)."""

    def __init__(self, config: DiffusionConfig, seen: int) -> None:
        super().__init__()
        self.embedding = config.step_embedding
        self.tell_step = nn.Sequential(
            nn.Linear(self.embedding, 4 * self.embedding), nn.Mish(), nn.Linear(4 * self.embedding, self.embedding)
        )
        told, widths = self.embedding + seen, (config.action_size, *config.widths)

        def pair(width_in: int, width: int) -> nn.ModuleList:
            return nn.ModuleList([_Block(config, width_in, width, told), _Block(config, width, width, told)])

        steps = list(zip(widths[:-1], widths[1:], strict=True))
        self.down = nn.ModuleList(pair(a, b) for a, b in steps)
        self.halved = nn.ModuleList(nn.Conv1d(width, width, 3, 2, 1) for width in config.widths[:-1])
        self.middle = pair(widths[-1], widths[-1])
        # what went down at the same time scale is laid beside what comes up
        self.up = nn.ModuleList(pair(2 * b, a) for a, b in reversed(steps[1:]))
        self.doubled = nn.ModuleList(nn.ConvTranspose1d(a, a, 4, 2, 1) for a, _ in reversed(steps[1:]))
        self.out = nn.Sequential(
            _convolution(config, config.widths[0], config.widths[0]), nn.Conv1d(config.widths[0], config.action_size, 1)
        )

    def forward(self, actions: Tensor, step: Tensor, seen: Tensor) -> Tensor:
        """Run it."""
        told = torch.cat([self.tell_step(_waves(step, self.embedding)), seen], -1)
        x, passed = actions.transpose(1, 2), []
        for level, pair in enumerate(self.down):
            x = self._through(pair, x, told)
            passed.append(x)
            if level < len(self.halved):
                x = self.halved[level](x)
        x = self._through(self.middle, x, told)
        for pair, doubled in zip(self.up, self.doubled, strict=True):
            x = doubled(self._through(pair, torch.cat([x, passed.pop()], 1), told))
        return self.out(x).transpose(1, 2)

    @staticmethod
    def _through(pair: nn.Module, x: Tensor, told: Tensor) -> Tensor:
        for block in pair.children():
            x = block(x, told)
        return x


class _Block(nn.Module):
    """x + conv(FiLM(conv(x))), with a 1 x 1 convolution on the way past where the channels change."""

    def __init__(self, config: DiffusionConfig, width_in: int, width: int, told: int) -> None:
        super().__init__()
        self.first, self.second = _convolution(config, width_in, width), _convolution(config, width, width)
        self.film = nn.Sequential(nn.Mish(), nn.Linear(told, 2 * width))
        self.past = nn.Conv1d(width_in, width, 1) if width_in != width else nn.Identity()

    def forward(self, x: Tensor, told: Tensor) -> Tensor:
        scale, shift = self.film(told)[..., None].chunk(2, 1)
        return self.past(x) + self.second(scale * self.first(x) + shift)


def _convolution(config: DiffusionConfig, width_in: int, width: int) -> nn.Module:
    """A convolution over time, normalized in groups of channels."""
    return nn.Sequential(
        nn.Conv1d(width_in, width, config.kernel, padding=config.kernel // 2),
        nn.GroupNorm(config.groups, width),
        nn.Mish(),
    )


def _waves(step: Tensor, size: int) -> Tensor:
    """(N, size) sines and cosines of k / 10000^(i / (size / 2 - 1))."""
    rate = torch.exp(torch.arange(size // 2, device=step.device) * (-math.log(10000.0) / (size // 2 - 1)))
    phase = step[:, None] * rate
    return torch.cat([phase.sin(), phase.cos()], -1)

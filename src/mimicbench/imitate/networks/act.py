"""Action chunking with transformers (Zhao et al. 2023), as the paper uses it: one map, one state, a chunk of joint
targets.

Training: a conditional variational autoencoder. Its encoder reads [CLS, state, the demonstrated chunk] and gives the
mean and log-variance of a latent z, which stands for what state and map do not decide. The policy, which is the
decoder, reads [z, state, one token per map feature] with a transformer encoder, and a transformer decoder turns one
learned query per frame of the chunk into actions:

    loss = L1(actions) + kl_weight * KL(q(z | state, actions) || N(0, 1))

At inference z = 0 and only the first action of the chunk is executed, in every frame: no open-loop chunk, and no
ensembling unless it is asked for.

Two things differ from the original program on purpose. It declares seven decoder layers but reads the output of the
first, so six of them are never trained; here the last layer's output is read. And its image network starts from
weights learned on photographs and keeps them almost as they are; here it is learned from nothing, on height maps.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.encoder import Encoder, sine_positions_2d
from mimicbench.imitate.inputs import Batch, Learner
from mimicbench.imitate.learners.act import ACTConfig


class ACT(Learner):
    """The whole of it: variational encoder, map encoder, transformer, action head."""

    kind = "act"

    def __init__(self, config: ACTConfig) -> None:
        # what is said of a later frame differs more from the present one
        super().__init__(config.inputs, (*([config.chunk] if config.relative else []), config.action_size))
        self.config, self.ensembles = config, config.ensembles
        width = config.hidden
        # variational encoder: only in training
        self.cls = nn.Parameter(torch.randn(1, 1, width))
        self.state_to_posterior = nn.Linear(config.inputs.seen_size, width)
        self.action_to_posterior = nn.Linear(config.action_size, width)
        self.posterior_layers = nn.ModuleList(_EncoderLayer(config) for _ in range(config.posterior_layers))
        self.posterior = nn.Linear(width, 2 * config.latent)
        self.register_buffer("posterior_positions", _sine_positions(config.chunk + 2, width), persistent=False)
        # policy
        self.latent_to_token = nn.Linear(config.latent, width)
        self.state_to_token = nn.Linear(config.inputs.seen_size, width)
        self.token_positions = nn.Parameter(torch.randn(1, 2, width))
        if config.inputs.sees:
            self.map_encoder = Encoder(replace(config.encoder, channels=config.inputs.seen_channels))
            self.map_to_token = nn.Conv2d(config.encoder.widths[-1], width, 1)
            self.register_buffer("map_positions", sine_positions_2d(config.encoder.side, width), persistent=False)
        if config.goal_weight:
            self.finds = self.goal_head(config.encoder.widths[-1] * config.encoder.side**2)
        self.encoder_layers = nn.ModuleList(_EncoderLayer(config) for _ in range(config.encoder_layers))
        self.decoder_layers = nn.ModuleList(_DecoderLayer(config) for _ in range(config.decoder_layers))
        self.decoder_norm = nn.LayerNorm(width)
        self.queries = nn.Parameter(torch.randn(1, config.chunk, width))
        self.head = nn.Linear(width, config.action_size)
        for module in (self.posterior_layers, self.encoder_layers, self.decoder_layers):
            for weight in module.parameters():
                if weight.dim() > 1:
                    nn.init.xavier_uniform_(weight)

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """L1 over the frames of the chunk that exist, and the divergence of z."""
        state, actions = self.normalized_input(batch.vector), self.normalized_actions(batch.actions)
        mean, log_variance = self._posterior(state, actions, batch.pad)
        z = mean + (0.5 * log_variance).exp() * torch.randn(mean.shape, generator=generator, device=mean.device)
        features = self.features(batch.picture)
        found = self._decode(z, state, features)
        l1 = ((found - actions).abs() * ~batch.pad[..., None]).mean()
        kl = -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).sum(-1).mean()
        return self.with_goal({"loss": l1 + self.config.kl_weight * kl, "l1": l1, "kl": kl}, features, batch)

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The actions (N, chunk, A) [rad] for z = 0."""
        state = self.normalized_input(vector)
        chunk = self._decode(state.new_zeros(len(state), self.config.latent), state, self.features(picture))
        return chunk * self.action_std + self.action_mean

    def _posterior(self, state: Tensor, actions: Tensor, pad: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance (B, latent) of q(z | state, actions)."""
        tokens = torch.cat(
            [
                self.cls.expand(len(state), -1, -1),
                self.state_to_posterior(state)[:, None],
                self.action_to_posterior(actions),
            ],
            1,
        )
        visible = torch.cat([pad.new_ones(len(pad), 2), ~pad], 1)[:, None, None]
        for layer in self.posterior_layers:
            tokens = layer(tokens, self.get_buffer("posterior_positions"), visible)
        mean, log_variance = self.posterior(tokens[:, 0]).chunk(2, -1)
        return mean, log_variance

    def _decode(self, z: Tensor, state: Tensor, features: Tensor | None) -> Tensor:
        """Normalized actions (B, chunk, A)."""
        tokens = [self.latent_to_token(z)[:, None], self.state_to_token(state)[:, None]]
        positions = self.token_positions
        if features is not None:
            tokens.append(self.map_to_token(features).flatten(2).transpose(1, 2))
            positions = torch.cat([positions, self.get_buffer("map_positions")], 1)
        memory = torch.cat(tokens, 1)
        for layer in self.encoder_layers:
            memory = layer(memory, positions)
        chunk = torch.zeros_like(self.queries).expand(len(z), -1, -1)
        for layer in self.decoder_layers:
            chunk = layer(chunk, self.queries, memory, positions)
        return self.head(self.decoder_norm(chunk))


class _Attention(nn.Module):
    """Multi-head attention of queries (B, Q, D) over keys and values (B, K, D)."""

    def __init__(self, config: ACTConfig) -> None:
        super().__init__()
        self.heads, self.dropout = config.heads, config.dropout
        self.query, self.key = nn.Linear(config.hidden, config.hidden), nn.Linear(config.hidden, config.hidden)
        self.value, self.out = nn.Linear(config.hidden, config.hidden), nn.Linear(config.hidden, config.hidden)

    def forward(self, query: Tensor, key: Tensor, value: Tensor, visible: Tensor | None = None) -> Tensor:
        """`visible` (B, 1, 1, K): which keys may be looked at; all if None."""
        q, k, v = (self._split(layer(x)) for layer, x in ((self.query, query), (self.key, key), (self.value, value)))
        # in bfloat16 its gradient takes fifteen times as long on a CPU
        with torch.autocast(q.device.type, enabled=False):
            dropout = self.dropout if self.training else 0.0
            mixed = functional.scaled_dot_product_attention(q.float(), k.float(), v.float(), visible, dropout)
        return self.out(mixed.transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class _EncoderLayer(nn.Module):
    """Self-attention and feed-forward, normalized after each. Positions are added to queries and keys only."""

    def __init__(self, config: ACTConfig) -> None:
        super().__init__()
        self.attention, self.feedforward = _Attention(config), _feedforward(config)
        self.norms = nn.ModuleList(nn.LayerNorm(config.hidden) for _ in range(2))
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, positions: Tensor, visible: Tensor | None = None) -> Tensor:
        placed = x + positions
        x = self.norms[0](x + self.dropout(self.attention(placed, placed, x, visible)))
        return self.norms[1](x + self.dropout(self.feedforward(x)))


class _DecoderLayer(nn.Module):
    """Self-attention among the chunk, attention to the encoder's tokens, feed-forward."""

    def __init__(self, config: ACTConfig) -> None:
        super().__init__()
        self.attention, self.look, self.feedforward = _Attention(config), _Attention(config), _feedforward(config)
        self.norms = nn.ModuleList(nn.LayerNorm(config.hidden) for _ in range(3))
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, queries: Tensor, memory: Tensor, positions: Tensor) -> Tensor:
        placed = x + queries
        x = self.norms[0](x + self.dropout(self.attention(placed, placed, x)))
        x = self.norms[1](x + self.dropout(self.look(x + queries, memory + positions, memory)))
        return self.norms[2](x + self.dropout(self.feedforward(x)))


def _feedforward(config: ACTConfig) -> nn.Module:
    return nn.Sequential(
        nn.Linear(config.hidden, config.feedforward),
        nn.ReLU(),
        nn.Dropout(config.dropout),
        nn.Linear(config.feedforward, config.hidden),
    )


def _sine_positions(length: int, width: int) -> Tensor:
    """(1, length, width): sin and cos of i / 10000^(2 k / width) (Vaswani et al. 2017)."""
    rate = torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
    phase = torch.arange(length)[:, None] * rate
    return torch.stack([phase.sin(), phase.cos()], -1).flatten(1)[None]

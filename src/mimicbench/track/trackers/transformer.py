"""The transformer of original HST."""

import torch
from torch import Tensor, nn

from mimicbench.track.trackers.hst_original import TransformerConfig


class Transformer(nn.Module):
    """(N, frames * width) -> (N, outputs)."""

    def __init__(self, config: TransformerConfig, width: int, frames: int, outputs: int) -> None:
        super().__init__()
        self.frames = frames
        self.embed = nn.Sequential(nn.Linear(width, config.tokens), nn.Dropout(config.dropout))
        self.positions = nn.Parameter(torch.randn(1, frames, config.tokens))
        self.blocks = nn.Sequential(*(_Block(config) for _ in range(config.blocks)))
        self.head = nn.Sequential(nn.LayerNorm(config.tokens), nn.Linear(config.tokens, outputs))

    def forward(self, obs: Tensor) -> Tensor:
        """(N, outputs) from (N, frames * width)."""
        x = self.embed(obs.unflatten(-1, (self.frames, -1))) + self.positions
        return self.head(self.blocks(x)[:, -1])


class _Block(nn.Module):
    """What attention and layers add is added to what was normalized, not to what came in."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        size = config.tokens
        self.norms = nn.ModuleList(nn.LayerNorm(size) for _ in range(2))
        self.attention = nn.MultiheadAttention(size, config.heads, config.dropout, batch_first=True)
        self.layers = nn.Sequential(
            nn.Linear(size, 4 * size), nn.GELU(), nn.Linear(4 * size, size), nn.Dropout(config.dropout)
        )

    def forward(self, x: Tensor) -> Tensor:
        x = self.norms[0](x)
        x = self.norms[1](x + self.attention(x, x, x, need_weights=False)[0])
        return x + self.layers(x)

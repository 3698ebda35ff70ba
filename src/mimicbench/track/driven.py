"""Clips on which somebody else drives, while an expert says in every frame what should be done (DAgger, Ross et al.
2011).
"""

import numpy as np
import torch

from mimicbench.core.seeds import digest
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.policy import Policy
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.experts import Corrigible, Expert
from mimicbench.track.rollout import Recording, at_their_beginning
from mimicbench.track.settings import DrivenConfig


@torch.no_grad()
@one_torch_thread
def drive_clips(
    expert: Expert,
    policy: Policy,
    clips: ClipSet,
    config: DrivenConfig | None = None,
    seed: int = 0,
    env_config: EnvConfig | None = None,
) -> Recording:
    """Episodes from the first frame of each clip, in which the expert drives first, then the policy.

    When the policy takes over is drawn for each, from all of its clip; in some it drives at once. `targets` of what is
    recorded are the expert's, `applied` those of who drove. An episode is as long as the expert knew what to do, which
    may have ended some time before it is seen (Expert.late); one without a frame that the policy drove is empty.
    """
    config, env_config = config or DrivenConfig(), env_config or EnvConfig()
    n = len(clips)
    env = at_their_beginning(expert, clips, Disturbance(), seed, env_config)
    assert env.bank is not None
    policy.to(env.device)
    random = torch.Generator().manual_seed(digest(seed, "takes over", *(m.id for m in clips.motions)) % (1 << 63))
    begins = (torch.rand(n, generator=random).to(env.device) * env.bank.lengths).long()
    if config.at_once:
        begins = torch.where((torch.rand(n, generator=random) < config.at_once).to(env.device), 0, begins)
    limit = round(clips.task.time_limit / CONTROL_DT)
    # who follows no clip has until the time limit, and so it goes on to where it may come to rest half way
    settle = round(config.settle / CONTROL_DT) if expert.follows else limit
    lengths = (env.bank.lengths + settle).clamp(max=limit)
    running, steps = torch.ones(n, dtype=torch.bool, device=env.device), torch.zeros_like(lengths)
    names = tuple(dict.fromkeys((*expert.observations, *policy.observations)))
    rows: list[tuple[np.ndarray, ...]] = []
    for step in range(int(lengths.max())):
        obs = env.observe(names)
        if step == 0:
            policy.reset(torch.arange(n, device=env.device), obs)
        wanted, _ = expert.says(env, obs)
        chosen = torch.where((step < begins)[:, None], wanted, policy.act(obs))
        if isinstance(policy, Corrigible):
            policy.drove(chosen)
        before = [array.astype(np.float32) for array in (env.physics.qpos(), env.physics.qvel())]
        env.step(chosen, expert.drove(env, chosen), running)
        rows.append((*before, wanted.cpu().numpy(), chosen.cpu().numpy()))
        steps += running
        lost = running & (expert.lost(env, config.ends) | env.physics.diverged)
        steps -= lost * round(expert.late / CONTROL_DT)
        running = running & ~lost & (steps < lengths)
        if not running.any():
            break
    env.close()
    ends = torch.where(steps > begins, steps, 0).tolist()
    per_episode = (np.stack(kept, 1) for kept in zip(*rows, strict=True))
    qpos, qvel, targets, applied = (
        [values[:end] for values, end in zip(kept, ends, strict=True)] for kept in per_episode
    )
    return Recording(qpos, qvel, targets, applied)

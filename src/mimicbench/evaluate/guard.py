"""A policy at arm's length: what it does wrong ends the episodes concerned, and no others."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn, TypeVar

import torch
from mujoco import mjMAXVAL
from torch import Tensor

from mimicbench.core.errors import MimicbenchError, NotObserved, told
from mimicbench.core.files import back_again
from mimicbench.envs.policy import Policy
from mimicbench.sensors.observations import Observations

T = TypeVar("T")
PATIENCE = 300.0
"""[s] that a policy may take to decide for all robots of a batch: where twenty of 128 plan anew at a time, each for
some seconds, on a busy machine, that is not too slow."""
BEFOREHAND = 10.0
"""So many times as long it may take to reset them, for before an episode everybody plans."""


class TooSlow(BaseException):
    """A policy did not answer in time. It is no Exception, for policies may catch all of these."""


class Guard:
    """Asks a policy for the targets of N robots, and keeps in which episodes it gave none."""

    def __init__(self, policy: Policy, target: Tensor, patience: float = PATIENCE) -> None:
        """`target` (N, J): what joints are given until the policy says otherwise; `patience` as PATIENCE [s]."""
        self._policy, self._last, self._patience = policy, target, patience
        self.sound = torch.ones(len(target), dtype=torch.bool, device=target.device)
        """(N,) the episodes in which every target so far was finite, and no larger than the physics take."""
        self._huge = ~self.sound
        self._error = ""

    def to(self, device: str) -> None:
        """The policy is to run on a device. Raises MimicbenchError, which is something that the user can mend."""
        self._tried("to", lambda: self._policy.to(device), self._patience)

    def reset(self, ids: Tensor, obs: Observations) -> None:
        """All N episodes begin. Raises MimicbenchError, which is something that the user can mend."""
        if not self._error:
            self._tried("reset", lambda: self._policy.reset(ids, obs), self._patience * BEFOREHAND)

    def act(self, obs: Observations) -> Tensor | None:
        """(N, J) targets, the last good ones of robots that are given none that are finite and not huge; None if there
        are none at all.
        """
        target = None if self._error else self._tried("act", lambda: self._policy.act(obs), self._patience)
        if self._error:
            return None
        if not isinstance(target, Tensor) or target.shape != self._last.shape:
            given = f"a tensor of {tuple(target.shape)}" if isinstance(target, Tensor) else type(target).__name__
            self._error = f"act gave {given} instead of a tensor of {tuple(self._last.shape)}"
            return None
        if not target.is_floating_point() or target.device != self._last.device:
            self._error = f"act gave {target.dtype} on {target.device} instead of numbers on {self._last.device}"
            return None
        target = target.to(self._last.dtype)  # or all that is observed from then on would be as precise
        # without asking the device whether there are any
        small = (target.abs() <= mjMAXVAL).all(-1)  # beyond that the physics would break
        self._huge = self._huge | (self.sound & ~small & target.isfinite().all(-1))
        self.sound = self.sound & small
        self._last = torch.where(self.sound[:, None], target, self._last)
        return self._last

    def errors(self) -> dict[int, str]:
        """What was wrong, by episode."""
        found = dict.fromkeys((~self.sound).nonzero()[:, 0].tolist(), "act gave targets that are not finite")
        found |= dict.fromkeys(self._huge.nonzero()[:, 0].tolist(), f"act gave targets beyond {mjMAXVAL:g} rad")
        return {i: found.get(i, self._error) for i in range(len(self.sound))} if self._error else found

    def _tried(self, what: str, call: Callable[[], T], patience: float) -> T | None:
        try:
            with back_again(), deadline(patience):
                return call()
        except NotObserved as error:  # a mistake in the policy, as any other that it raises
            self._error = f"{what} raised {told(error)}"
            return None
        except MimicbenchError:
            raise
        except TooSlow:
            self._error = f"{what} took more than {patience:g} s"
            return None
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 somebody else's program may raise anything
            self._error = f"{what} raised {told(error)}"
            return None


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raises TooSlow once this has taken longer.

    Python's own code is interrupted by an alarm; code in C, and in threads other than the main one, only when it comes
    back.
    """
    begun = time.monotonic()
    if threading.current_thread() is not threading.main_thread():
        yield
    else:
        before = signal.signal(signal.SIGALRM, _too_slow)
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
    if time.monotonic() - begun > seconds:
        raise TooSlow


def _too_slow(number: int, frame: FrameType | None) -> NoReturn:
    raise TooSlow

"""Which instructions a pickle may have, and how large the values are that they make."""

import pickletools
from typing import Any

MAX_OPCODES = 20_000
"""Instructions in one pickle; the motion files that we know have a few hundred."""
MAX_VALUES = 1_000_000
"""Values in one value, each as often as it is in it."""

OPCODES = frozenset(
    {
        "PROTO",
        "FRAME",
        "STOP",
        "MARK",
        "POP",
        "POP_MARK",
        "NONE",
        "NEWTRUE",
        "NEWFALSE",
        "BININT",
        "BININT1",
        "BININT2",
        "LONG1",
        "LONG4",
        "BINFLOAT",
        "BINUNICODE",
        "SHORT_BINUNICODE",
        "BINUNICODE8",
        "BINBYTES",
        "SHORT_BINBYTES",
        "BINBYTES8",
        "EMPTY_LIST",
        "APPEND",
        "APPENDS",
        "EMPTY_TUPLE",
        "TUPLE",
        "TUPLE1",
        "TUPLE2",
        "TUPLE3",
        "EMPTY_DICT",
        "DICT",
        "LIST",
        "SETITEM",
        "SETITEMS",
        "BINPUT",
        "LONG_BINPUT",
        "MEMOIZE",
        "BINGET",
        "LONG_BINGET",
        "GLOBAL",
        "STACK_GLOBAL",
        "REDUCE",
        "BUILD",
    }
)


class Sizes:
    """How many values each value on a pickle's stack holds, counted as often as they are in it.

    A tuple of twice the same tuple, and so on, is short as a pickle, and takes for ever to hash or to print.
    """

    def __init__(self) -> None:
        self._stack: list[int | None] = []
        """None for a mark."""
        self._memo: dict[int, int] = {}

    def follow(self, opcode: pickletools.OpcodeInfo, argument: Any) -> None:
        """What one instruction does. Raises ValueError if a value becomes too large."""
        stack, popped = self._stack, 0
        if "GET" in opcode.name:
            stack.append(self._memo[int(argument)])
        elif "PUT" in opcode.name or opcode.name == "MEMOIZE":
            if (value := stack[-1]) is None:
                raise ValueError("it remembers a mark, which is no value")
            self._memo[len(self._memo) if opcode.name == "MEMOIZE" else int(argument)] = value
        elif opcode.name == "MARK":
            stack.append(None)
        else:
            wanted = list(opcode.stack_before)
            if pickletools.markobject in wanted:
                while (value := stack.pop()) is not None:
                    popped += value
                wanted = wanted[: wanted.index(pickletools.markobject)]
            popped += sum(stack.pop() or 0 for _ in wanted)
            if popped > MAX_VALUES:
                raise ValueError(f"a value that holds more than {MAX_VALUES} others")
            stack.extend(1 + popped for _ in opcode.stack_after)

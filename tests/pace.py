"""How fast this machine is now: what is measured in its units is a ratio within one run."""

import time


def unit():
    """Processor time [s] of a fixed piece of Python, the least of several: 10 to 20 ms."""
    spent = []
    for _ in range(7):
        start = time.process_time()
        sum(i * i for i in range(200_000))
        spent.append(time.process_time() - start)
    return min(spent)

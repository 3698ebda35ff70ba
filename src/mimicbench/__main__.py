"""`python -m mimicbench` is the command `mimicbench`."""

from mimicbench.cli import main

if __name__ == "__main__":
    main()

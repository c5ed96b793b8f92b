"""The command line: `python -m symgrasp` does the same as `symgrasp`."""

from symgrasp_cli.main import main

if __name__ == "__main__":
    main()

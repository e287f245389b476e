"""`python -m whid` is `whid`."""

from whid.cli import main

if __name__ == "__main__":
    main(prog_name="whid")

"""`python -m ehsa_ctrl`: the command `ehsa-ctrl`, also where the scripts of the environment are not on the path."""

from .cli.main import main

if __name__ == "__main__":
    main()

"""``python -m automcm_cli`` is the command ``automcm``."""

from automcm_cli.main import main

if __name__ == "__main__":
    main()

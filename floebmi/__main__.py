"""`python -m floebmi` is the command `floebmi`."""

from floebmi.cli import main

if __name__ == "__main__":
    main()

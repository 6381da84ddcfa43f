"""`python -m eigenbench` is the command `eigenbench`."""

from eigenbench.cli import main

main()

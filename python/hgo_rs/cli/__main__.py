"""`python -m hgo_rs.cli`."""

from hgo_rs.cli import main

main()

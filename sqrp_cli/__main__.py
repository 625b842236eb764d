"""`python -m sqrp_cli`, as `sqrp`."""

from sqrp_cli.cli.main import main

main()

"""The Python API: a cell, and methods that answer questions about it.

    from sqrp_cli import open_cell

    ranking = open_cell("workspaces/tabletop").rank("pickup green")
    print(ranking)                        # the table of `sqrp rank`
    ranking.candidates[0].q_eoi           # its figures

Results are typed documents, the same as `--json` prints, and show themselves as the terminal's tables, also in a
notebook.
"""

"""New workspaces: a cell around an arm in which a first task can be ranked at once."""

"""New workspaces: what stands around an arm so that a first task can be ranked at once."""

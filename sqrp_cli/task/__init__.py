"""Words of a task come in; its candidates go out: what each would move, watch and lose."""

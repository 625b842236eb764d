"""What is common to the trees that lark makes of a text."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

if TYPE_CHECKING:
    from lark import Token, Tree


def is_token(node: Tree[Token] | Token) -> TypeGuard[Token]:
    """Whether a node is a token, not a tree."""
    return isinstance(node, str)


def depth(tree: Tree[Token]) -> int:
    """Levels of the tree; found without recursion, so that no input exhausts the stack."""
    deepest, open_trees = 0, [(tree, 1)]
    while open_trees:
        top, level = open_trees.pop()
        deepest = max(deepest, level)
        open_trees += [(part, level + 1) for part in top.children if not is_token(part)]
    return deepest

"""Parsing in several threads."""

import ast
from concurrent.futures import ThreadPoolExecutor

from ehsa_ctrl.core.syntax import parse_expression, parse_statement


def test_threads_parse_at_once():
    """The same trees as one thread makes, thousands of times; CPython 3.11 alone raises SystemError now and then."""
    text = "+".join(f"(a_{k} * sin(b_{k} - {k}))" for k in range(40))
    expected = ast.dump(parse_expression(text))

    with ThreadPoolExecutor(8) as pool:
        found = set(pool.map(lambda _: ast.dump(parse_expression(text)), range(400)))

    assert found == {expected}


def test_an_indented_statement():
    """As the source of a method is."""
    tree = parse_statement("    def f(x):\n        return x\n")

    assert isinstance(tree, ast.FunctionDef) and tree.name == "f"

"""Commented TOML for `ehsa-ctrl new`: a shipped definition with what each key means, and the keys that it leaves out.

The words come from the docstrings of the forms (core.described) and from the registries, the numbers from the shipped
catalogue; what is here is order and layout.
"""

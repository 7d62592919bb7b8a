"""The package as a whole: stubs, docstrings and documentation match the compiled module."""

import ast
import inspect
import re
import unittest

import tactus
from support import SOURCE


def members(cls):
    return {name for name, value in vars(cls).items()
            if not name.startswith("_") and (callable(value) or isinstance(value, (property, staticmethod)))}


def stub():
    """Returns the functions, and the members of the classes, that the stub declares."""
    functions, classes = {}, {}
    for node in ast.parse((SOURCE / "python/tactus/__init__.pyi").read_text()).body:
        if isinstance(node, ast.FunctionDef):
            functions[node.name] = node
        elif isinstance(node, ast.ClassDef):
            classes[node.name] = {item.name: item for item in node.body if isinstance(item, ast.FunctionDef)}
    return functions, classes


def compiled_arguments(function):
    """The names of the arguments in the signature that pybind11 writes into the docstring."""
    signature = function.__doc__.splitlines()[0]
    inside = signature[signature.index("(") + 1:signature.rindex(") ->")]
    depth, names, part = 0, [], ""
    for letter in inside + ",":
        depth += (letter in "([{<") - (letter in ")]}>")
        if letter == "," and depth == 0:
            names.append(part.split(":")[0].split("=")[0].strip())
            part = ""
        else:
            part += letter
    return [name for name in names if name not in ("", "*", "self")]


class StubTest(unittest.TestCase):
    def setUp(self):
        self.functions, self.classes = stub()

    def test_the_stub_has_the_public_names(self):
        public = set(tactus.__all__)
        self.assertEqual(public, {name for name in dir(tactus) if not name.startswith("_")})
        self.assertLessEqual(public, self.functions.keys() | self.classes.keys())

    def test_the_stub_has_the_members_of_each_class(self):
        for name in tactus.__all__:
            if inspect.isclass(getattr(tactus, name)):
                declared = {member for member in self.classes[name] if not member.startswith("__")}
                self.assertEqual(declared, members(getattr(tactus, name)), name)

    def test_the_stub_has_the_arguments_of_each_function(self):
        def check(node, function):
            declared = [argument.arg for argument in node.args.args + node.args.kwonlyargs if argument.arg != "self"]
            if node.args.vararg:
                declared.append("*" + node.args.vararg.arg)
            self.assertEqual(declared, compiled_arguments(function), node.name)

        for name, node in self.functions.items():
            check(node, getattr(tactus, name))
        for name, methods in self.classes.items():
            for method, node in methods.items():
                if not any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list):
                    check(node, getattr(getattr(tactus, name), method))


class DocumentationTest(unittest.TestCase):
    def test_everything_public_has_a_docstring(self):
        for name in tactus.__all__:
            value = getattr(tactus, name)
            self.assertTrue(value.__doc__, name)
            if inspect.isclass(value):
                for member in members(value):
                    text = inspect.getdoc(getattr(value, member)) or ""
                    text = text.split("\n\n", 1)[-1] if "->" in text.splitlines()[0] else text
                    self.assertTrue(text.strip(), f"{name}.{member}")

    def test_the_reference_lists_everything_public(self):
        reference = (SOURCE / "docs/reference/python.md").read_text()
        for name in tactus.__all__:
            self.assertTrue(f"`{name}" in reference, f"{name} is not in docs/reference/python.md")
            if inspect.isclass(getattr(tactus, name)):
                for member in members(getattr(tactus, name)):
                    self.assertTrue(re.search(rf"`(\w+\.)?{member}\b", reference), f"{name}.{member} is not in it")


if __name__ == "__main__":
    unittest.main()

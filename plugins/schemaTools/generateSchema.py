"""Makes a schema library of OpenUSD from one schema.usda: plugInfo.json and generatedSchema.usda with OpenUSD's own
usdGenSchema, and from the same file classes that read and write the schemas, in C++ over usdlive::stage::Prim and
in Python over pxr.Usd.Prim.

usage: generateSchema.py schema.usda FOLDER [--cpp HEADER] [--python MODULE]

Needs usd-core and Jinja2. Writes a file only if its content changes.
"""

import argparse
import json
import keyword
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent


def run_usd_gen_schema(schema, folder):
    """usdGenSchema merges into files that exist, so it gets an empty folder."""
    made = subprocess.run([sys.executable, "-m", "pxr.Usd.usdGenSchema", str(schema), str(folder), "--quiet"],
                          capture_output=True, text=True)
    # It exits with 0 after some of its errors.
    if made.returncode or not (folder / "generatedSchema.usda").exists():
        sys.exit(f"{schema}: usdGenSchema failed:\n{made.stderr.strip() or made.stdout.strip()}")


def plug_info(text):
    """Fills in the placeholders: all files are in one folder, and no library has to be loaded."""
    info = json.loads("".join(line for line in text.splitlines(True) if not line.startswith("#")))
    for plugin in info["Plugins"]:
        plugin.update(Type="resource", Root=".", LibraryPath="", ResourcePath=".")
    return json.dumps(info, indent=4, sort_keys=True) + "\n"


# --- accessors -----------------------------------------------------------------------------------------


# Names that a class cannot have for an accessor: words of the language, and members of all schema classes.
TAKEN = {
    "accessors.py.jinja": {*keyword.kwlist, *"""
        all apply attribute define identifier instance prim property_name relationship remove""".split()},
    "accessors.h.jinja": set("""
        alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t class co_await
        co_return co_yield compl concept const const_cast consteval constexpr constinit continue decltype default delete do
        double dynamic_cast else enum explicit export extern false float for friend goto if inline int long mutable namespace
        new noexcept not not_eq nullptr operator or or_eq private protected public register reinterpret_cast requires return
        short signed sizeof static static_assert static_cast struct switch template this thread_local throw true try typedef
        typeid typename union unsigned using virtual void volatile wchar_t while xor xor_eq
        apply appliedName applyToPrim define definePrim get isValid prim propertyName remove removeFromPrim set setTargets
        targets valueOf""".split()),
}


class Property:
    def __init__(self, spec, namespace):
        from pxr import Sdf, Usd
        # A property with the name of the instance itself is read by the last word of the namespace.
        is_instance = spec.name == "__INSTANCE_NAME__"
        self.name = Usd.SchemaRegistry.MakeMultipleApplyNameTemplate(
            namespace, "" if is_instance else spec.name) if namespace else spec.name
        self.accessor = (namespace if is_instance else spec.name).split(":")[-1]
        self.setter = "set" + self.accessor[0].upper() + self.accessor[1:]
        self.snake = re.sub(r"(?<=[a-z0-9])([A-Z])", lambda found: "_" + found[1].lower(), self.accessor)
        self.doc = one_line(spec.documentation)
        self.is_relationship = isinstance(spec, Sdf.RelationshipSpec)
        self.is_uniform = spec.variability == Sdf.VariabilityUniform
        if self.is_relationship:
            return
        self.type = str(spec.typeName)
        self.cpp = re.sub(r"\b(?=(Tf|Gf|Vt|Sdf)[A-Z])", "pxr::", spec.typeName.cppTypeName)
        self.cpp = self.cpp.replace("string", "std::string") if self.cpp == "string" else self.cpp
        tokens = spec.GetInfo("allowedTokens")
        if tokens:
            self.doc += " One of " + ", ".join(f'"{token}"' for token in tokens) + "."


def class_name(prim):
    return prim.customData.get("className") or prim.name[0].upper() + prim.name[1:]


class Schema:
    def __init__(self, prim, kind):
        self.identifier = prim.name
        self.kind = kind
        self.name = class_name(prim)
        self.doc = one_line(prim.documentation)
        parent = prim.inheritPathList.GetAddedOrExplicitItems()[0].name
        # A schema of another library is no base class here.
        inherited = prim.layer.GetPrimAtPath("/" + parent)
        self.base = class_name(inherited) if inherited else None
        known = {spec.name for base in ancestors(inherited) for spec in base.properties}
        self.properties = [Property(spec, prim.customData.get("propertyNamespacePrefix"))
                           for spec in prim.properties if spec.name not in known]
        twice = [one.accessor for at, one in enumerate(self.properties)
                 if any(other.accessor == one.accessor for other in self.properties[:at])]
        if twice:
            sys.exit(f"{prim.layer.identifier}: two properties of '{self.identifier}' end with '{twice[0]}', "
                     f"and would get the same accessor")


def check_names(layer, schemas, template):
    for schema in schemas:
        for member in schema.properties:
            for name in (member.snake,) if template.endswith(".py.jinja") else (member.accessor, member.setter):
                if name in TAKEN[template]:
                    sys.exit(f"{layer.identifier}: the property '{member.name}' of '{schema.identifier}' would get the accessor "
                             f"'{name}', a name that has another meaning in the class. End it with another word")


def ancestors(prim):
    """The schema and those of the same library that it inherits from."""
    while prim:
        yield prim
        parents = prim.inheritPathList.GetAddedOrExplicitItems()
        prim = prim.layer.GetPrimAtPath(parents[0]) if parents else None


def one_line(text):
    return " ".join(text.split())


def kinds_in(info):
    """Returns the kind of each schema, by its identifier, as OpenUSD reads it in the text of a plugInfo.json."""
    types = [one for plugin in json.loads(info)["Plugins"] for one in plugin["Info"]["Types"].values()]
    return {one["schemaIdentifier"]: one["schemaKind"] for one in types}


def accessors(schema, kinds, template):
    """Renders a template with all schemas of the file, each after the one that it inherits from."""
    import jinja2
    from pxr import Sdf
    layer = Sdf.Layer.FindOrOpen(str(schema))
    library = layer.GetPrimAtPath("/GLOBAL").customData["libraryName"]
    classes = [prim for prim in layer.rootPrims if prim.specifier == Sdf.SpecifierClass]
    schemas = [Schema(prim, kinds[prim.name]) for prim in sorted(classes, key=lambda prim: len(list(ancestors(prim))))]
    check_names(layer, schemas, template)
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(HERE), trim_blocks=True, lstrip_blocks=True,
                                     keep_trailing_newline=True, undefined=jinja2.StrictUndefined)
    types = {kind for one in schemas for member in one.properties if not member.is_relationship
             for kind in re.findall(r"pxr::(Gf|Sdf)(\w+)", member.cpp)}
    folders = {"Gf": "base/gf", "Sdf": "usd/sdf"}
    headers = sorted(f"pxr/{folders[library]}/{kind[0].lower()}{kind[1:]}.h" for library, kind in types)
    return environment.get_template(template).render(library=library, source=pathlib.Path(schema).name,
                                                     schemas=schemas, headers=headers)


def write(path, text):
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description="Makes a schema library of OpenUSD from one schema.usda.")
    parser.add_argument("schema", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path, help="where plugInfo.json and generatedSchema.usda go")
    parser.add_argument("--cpp", metavar="HEADER", help="writes C++ classes over usdlive::stage::Prim")
    parser.add_argument("--python", metavar="MODULE", help="writes Python classes over pxr.Usd.Prim")
    options = parser.parse_args()
    if not options.schema.is_file():
        sys.exit(f"{options.schema}: there is no such file")
    with tempfile.TemporaryDirectory() as temporary:
        made = pathlib.Path(temporary)
        run_usd_gen_schema(options.schema.resolve(), made)
        info = plug_info((made / "plugInfo.json").read_text(encoding="utf-8"))
        write(options.folder / "plugInfo.json", info)
        write(options.folder / "generatedSchema.usda", (made / "generatedSchema.usda").read_text(encoding="utf-8"))
    if options.cpp:
        write(options.cpp, accessors(options.schema, kinds_in(info), "accessors.h.jinja"))
    if options.python:
        write(options.python, accessors(options.schema, kinds_in(info), "accessors.py.jinja"))


if __name__ == "__main__":
    main()

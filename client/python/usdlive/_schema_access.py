"""The base of the classes in usdlive.schemas, which are generated from schema.usda."""

from __future__ import annotations

from pxr import Sdf, Usd


class Attribute:
    """Reads the composed value or the fallback, None if there is neither; writes at the default time, to the edit
    target of the stage. `schema.attribute("state")` is the Usd.Attribute, for other times and everything else."""

    def __init__(self, name: str, doc: str, type_name: str = "", is_uniform: bool = False):
        self.name, self.__doc__ = name, doc
        # No definition has them if the schema is a non-applied one.
        self.type_name, self.is_uniform = type_name, is_uniform

    def create(self, prim: Usd.Prim) -> Usd.Attribute:
        variability = Sdf.VariabilityUniform if self.is_uniform else Sdf.VariabilityVarying
        return prim.CreateAttribute(self.name, Sdf.ValueTypeNames.Find(self.type_name), False, variability)

    def __get__(self, schema, owner=None):
        if schema is None:
            return self
        attribute = schema.prim.GetAttribute(schema.property_name(self))
        return attribute.Get() if attribute else None

    def __set__(self, schema, value) -> None:
        attribute = schema.prim.GetAttribute(schema.property_name(self)) or schema._create(self)
        if attribute.GetTypeName() == Sdf.ValueTypeNames.TimeCode and not isinstance(value, Sdf.TimeCode):
            value = Sdf.TimeCode(value)  # pxr converts no numbers
        attribute.Set(value)


class Relationship:
    """Reads the targets, as a list of Sdf.Path; writes an explicit list of paths, or one path."""

    def __init__(self, name: str, doc: str):
        self.name, self.__doc__ = name, doc

    def create(self, prim: Usd.Prim) -> Usd.Relationship:
        return prim.CreateRelationship(self.name, False)

    def __get__(self, schema, owner=None):
        if schema is None:
            return self
        relationship = schema.prim.GetRelationship(schema.property_name(self))
        return relationship.GetTargets() if relationship else []

    def __set__(self, schema, targets) -> None:
        relationship = schema.prim.GetRelationship(schema.property_name(self)) or schema._create(self)
        one = isinstance(targets, (str, Sdf.Path))
        relationship.SetTargets([Sdf.Path(path) for path in ([targets] if one else targets)])


class Schema:
    """One schema of one prim; true if the prim has it."""

    identifier: str

    def __init__(self, prim: Usd.Prim):
        self.prim = prim

    def __setattr__(self, name: str, value) -> None:
        if name not in ("prim", "instance") and not hasattr(type(self), name):
            raise AttributeError(f"'{self.identifier}' has no property '{name}'")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.prim!r})"

    def attribute(self, name: str) -> Usd.Attribute:
        """The attribute behind a member, by the member's name: "state"."""
        return self.prim.GetAttribute(self.property_name(getattr(type(self), name)))

    def relationship(self, name: str) -> Usd.Relationship:
        return self.prim.GetRelationship(self.property_name(getattr(type(self), name)))

    def property_name(self, member) -> str:
        return member.name

    def _create(self, member):
        raise AttributeError(f"<{self.prim.GetPath()}> has no property '{self.property_name(member)}': it does not "
                             f"have the schema '{self.identifier}'")


class TypedSchema(Schema):
    """A prim of a type, or of one that inherits from it."""

    def __bool__(self) -> bool:
        return bool(self.prim) and self.prim.IsA(self.identifier)

    @classmethod
    def define(cls, stage: Usd.Stage, path):
        """Defines a prim of this type."""
        if Usd.SchemaRegistry().FindSchemaInfo(cls.identifier).kind == Usd.SchemaKind.AbstractTyped:
            raise TypeError(f"'{cls.identifier}' is abstract: define a prim of a type that inherits from it")
        return cls(stage.DefinePrim(path, cls.identifier))


class ApiSchema(Schema):
    """A single-apply API schema."""

    def __bool__(self) -> bool:
        return bool(self.prim) and self.prim.HasAPI(self.identifier)

    @classmethod
    def apply(cls, prim: Usd.Prim):
        """Adds the schema to the prim. Raises ValueError if the prim may not have it."""
        why_not = prim.CanApplyAPI(cls.identifier)
        if not why_not:
            raise ValueError(f"cannot apply '{cls.identifier}' to <{prim.GetPath()}>: {why_not.whyNot}")
        prim.ApplyAPI(cls.identifier)
        return cls(prim)

    def remove(self) -> None:
        self.prim.RemoveAPI(self.identifier)


class NonAppliedApiSchema(Schema):
    """An API schema that every prim has: it is not applied, and creates its properties when they are written."""

    def __bool__(self) -> bool:
        return bool(self.prim)

    def _create(self, member):
        return member.create(self.prim)


class MultipleApiSchema(Schema):
    """One instance of a multiple-apply API schema."""

    def __init__(self, prim: Usd.Prim, instance: str):
        super().__init__(prim)
        self.instance = instance

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.prim!r}, {self.instance!r})"

    def __bool__(self) -> bool:
        return bool(self.prim) and self.prim.HasAPI(self.identifier, self.instance)

    @classmethod
    def apply(cls, prim: Usd.Prim, instance: str):
        """Adds the schema, with this instance, to the prim. Raises ValueError if the prim may not have it."""
        why_not = prim.CanApplyAPI(cls.identifier, instance)
        if not why_not:
            raise ValueError(f"cannot apply '{cls.identifier}:{instance}' to <{prim.GetPath()}>: {why_not.whyNot}")
        prim.ApplyAPI(cls.identifier, instance)
        return cls(prim, instance)

    @classmethod
    def all(cls, prim: Usd.Prim) -> list:
        """The instances that the prim has, strong to weak."""
        prefix = cls.identifier + ":"
        return [cls(prim, name[len(prefix):]) for name in prim.GetAppliedSchemas() if name.startswith(prefix)]

    def remove(self) -> None:
        self.prim.RemoveAPI(self.identifier, self.instance)

    def property_name(self, member) -> str:
        return Usd.SchemaRegistry.MakeMultipleApplyNameInstance(member.name, self.instance)

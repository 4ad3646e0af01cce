"""Random edits of the layers of a stage from stage_seeds."""

from pxr import Sdf, Usd

import stage_seeds

MOST_ARCS = 6  # edits that may make arcs: too many multiply what is composed


class Editor:
    """Makes one edit after another. The names of those that were made are in `made`."""

    def __init__(self, seed, folder, stage, watched):
        self.maker = stage_seeds.Maker(seed, folder)
        self.r = self.maker.r
        self.stage, self.watched = stage, watched
        self.made = []
        self.muted = []
        self.arcs = MOST_ARCS

    def layers(self):
        """Those that the stage uses and that may be edited."""
        return sorted((layer for layer in self.stage.GetUsedLayers() if layer.permissionToEdit), key=lambda layer: layer.identifier)

    def some_layer(self):
        layers = self.layers()
        return self.stage.GetRootLayer() if self.r.random() < 0.3 else self.r.choice(layers)

    def specs(self, layer):
        """All prim specs, also within variants."""
        found = []

        def visit(path):
            spec = layer.GetObjectAtPath(path)
            if isinstance(spec, Sdf.PrimSpec) and path != Sdf.Path.absoluteRootPath:
                found.append(spec)

        layer.Traverse("/", visit)
        return sorted(found, key=lambda spec: str(spec.path))

    def edit(self):
        """Sdf refuses some edits; these change nothing."""
        edits = sorted(name for name in dir(self) if name.startswith("edit_"))
        layer = self.some_layer()
        specs = self.specs(layer)
        spec = self.r.choice(specs) if specs else layer.pseudoRoot
        name = self.r.choice(edits)
        if name in ("edit_stage", "edit_sublayers", "edit_relocates") and self.r.random() < 0.6:
            name = "edit_facts"
        if name in ("edit_arcs", "edit_new", "edit_variants"):
            self.arcs -= 1
            name = name if self.arcs >= 0 else "edit_value"
        if not specs and name not in ("edit_stage", "edit_sublayers", "edit_relocates"):
            name = "edit_new"
        self.made.append("%s of <%s> in %s" % (name[5:], spec.path, layer.GetDisplayName()))
        try:
            getattr(self, name)(layer, spec)
        except Exception as error:  # Tf.ErrorException: Sdf refuses it
            self.made[-1] += " (%s)" % str(error).strip().splitlines()[-1][:80]

    # --- prims ---

    def edit_new(self, layer, spec):
        parent = layer.pseudoRoot if spec == layer.pseudoRoot or self.r.random() < 0.2 else spec
        names = [name for name in stage_seeds.NAMES if name not in parent.nameChildren]
        if names:
            self.maker.fill(Sdf.PrimSpec(parent, self.r.choice(names), self.maker.specifier()), self.r.choice((0, 0, 1)))

    def edit_over(self, layer, spec):
        Sdf.CreatePrimInLayer(layer, stage_seeds.some_path(self.r))

    def edit_over_of_what_is_there(self, layer, _):
        prims = list(Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))[1:]
        if prims:
            over = Sdf.CreatePrimInLayer(self.stage.GetRootLayer(), self.r.choice(prims).GetPath())
            if self.r.random() < 0.7:
                self.maker.facts(over)
                self.maker.attribute(over)

    def edit_remove(self, layer, spec):
        if spec.path.IsPrimPath() and spec.nameParent:
            del spec.nameParent.nameChildren[spec.name]

    def edit_rename(self, layer, spec):
        name = self.r.choice(stage_seeds.NAMES)
        if spec.path.IsPrimPath() and name not in spec.nameParent.nameChildren:
            spec.name = name

    def edit_specifier(self, layer, spec):
        spec.specifier = self.maker.specifier()

    def edit_facts(self, layer, spec):
        self.maker.facts(spec)

    def edit_type(self, layer, spec):
        if self.r.random() < 0.3:
            spec.ClearInfo("typeName") if spec.specifier == Sdf.SpecifierOver else None
        else:
            spec.typeName = self.r.choice(stage_seeds.TYPES)

    def edit_instanceable(self, layer, spec):
        spec.instanceable = not spec.instanceable

    def edit_clear_fact(self, layer, spec):
        fields = [field for field in ("kind", "active", "instanceable", "apiSchemas", "customData", "documentation", "hidden",
                                      "propertyOrder", "primOrder") if spec.HasInfo(field)]
        if fields:
            spec.ClearInfo(self.r.choice(fields))

    def edit_active(self, layer, spec):
        spec.active = not spec.active

    def edit_arcs(self, layer, spec):
        self.maker.arcs(spec)

    def edit_clear_arcs(self, layer, spec):
        arcs = {"references": spec.referenceList, "payload": spec.payloadList, "inheritPaths": spec.inheritPathList,
                "specializes": spec.specializesList}
        known = [name for name in arcs if spec.HasInfo(name)]
        if known:
            arcs[self.r.choice(known)].ClearEdits()

    def edit_variants(self, layer, spec):
        if not spec.variantSets:
            self.maker.variants(spec, 1)
            return
        name = self.r.choice(sorted(spec.variantSets.keys()))
        if self.r.random() < 0.5:
            spec.variantSelections[name] = self.r.choice(("one", "two", "three", "absent"))
        elif spec.variantSets[name].variants:
            variant = self.r.choice(list(spec.variantSets[name].variants.values()))
            if self.r.random() < 0.5:
                spec.variantSets[name].RemoveVariant(variant)
            else:
                self.maker.attribute(variant.primSpec)

    def edit_order(self, layer, spec):
        spec.nameChildrenOrder = self.r.sample(stage_seeds.NAMES, 3)

    # --- properties ---

    def edit_attribute(self, layer, spec):
        self.maker.attribute(spec)

    def edit_relationship(self, layer, spec):
        self.maker.relationship(spec)

    def edit_remove_property(self, layer, spec):
        if spec.properties:
            spec.RemoveProperty(self.r.choice(list(spec.properties.values())))

    def edit_value(self, layer, spec):
        known = [prop for prop in spec.properties.values() if prop.name in stage_seeds.VALUES and isinstance(prop, Sdf.AttributeSpec)]
        if known:
            prop = self.r.choice(known)
            value = stage_seeds.VALUES[prop.name][1](self.r)
            choice = self.r.randrange(5)
            if choice == 0:
                layer.SetTimeSample(prop.path, self.r.choice((0, 1, 2.5)), value)
            elif choice == 1:
                prop.ClearDefaultValue()
            elif choice == 2:
                prop.default = Sdf.ValueBlock()
            else:
                prop.default = value

    def edit_targets(self, layer, spec):
        known = [prop for prop in spec.properties.values() if isinstance(prop, Sdf.RelationshipSpec)]
        if known:
            self.r.choice(known).targetPathList.explicitItems = [stage_seeds.some_path(self.r)]

    # --- layers and the stage ---

    def edit_stage(self, layer, spec):
        choice = self.r.randrange(4)
        if choice == 0:
            layer.defaultPrim = self.r.choice(stage_seeds.NAMES)
        elif choice == 1:
            layer.expressionVariables = stage_seeds.variables(layer, self.r.choice(("asset0", "asset1", "asset2", "gone")))
        else:
            self.maker.stage_facts(layer)

    def edit_sublayers(self, layer, spec):
        paths = list(layer.subLayerPaths)
        if paths and self.r.random() < 0.6:
            if self.r.random() < 0.5:
                layer.subLayerOffsets[0] = self.maker.offset()
            else:
                del layer.subLayerPaths[0]
        elif layer.GetDisplayName().startswith(("root", "session", "asset")):
            new = [name for name in ("./sub0.usda", "./sub1.usda") if name not in paths]
            if new:
                layer.subLayerPaths.insert(0, new[0])

    def edit_relocates(self, layer, spec):
        if layer.GetDisplayName() in ("root.usda", "asset0.usda"):
            if layer.HasRelocates() and self.r.random() < 0.5:
                layer.ClearRelocates()
            else:
                self.maker.relocates(layer)

    # --- not within a change block: both stages are changed, not layers ---

    def mute(self):
        names = [layer.identifier for layer in self.layers() if layer != self.stage.GetRootLayer()] + self.muted
        if not names:
            return
        name = self.r.choice(sorted(set(names)))
        self.made.append("mute or unmute %s" % name.split("/")[-1])
        muted = [one for one in self.muted if one != name] + ([] if name in self.muted else [name])
        self.stage.MuteAndUnmuteLayers([one for one in muted if one not in self.muted], [one for one in self.muted if one not in muted])
        self.watched.mute(muted)
        self.muted[:] = muted

    def load(self):
        with_payload = [prim.GetPath() for prim in Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.PrimAllPrimsPredicate) if prim.HasPayload()]
        path = self.r.choice(with_payload) if with_payload else Sdf.Path.absoluteRootPath
        loads = self.r.random() < 0.5
        self.made.append("%s <%s>" % ("load" if loads else "unload", path))
        self.stage.Load(path) if loads else self.stage.Unload(path)
        self.watched.load(path, loads)

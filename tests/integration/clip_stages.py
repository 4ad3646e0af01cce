"""Makes stages with value clips from seeds, and compares with pxr.Usd what ours shows of them, also after edits.

    clip_stages.py FIRST LAST FOLDER [STEPS]

Prints what differs; in the last line how many steps were compared. Ends with 1 if anything differs.
"""

import itertools
import os
import random

import stage_following
from pxr import Gf, Sdf, Usd, Vt
from stage_dump import Dump, differences
from stage_following import Follower, shown

VALUES = {
    "number": (Sdf.ValueTypeNames.Double, lambda r: r.uniform(-9, 9)),
    "floats": (Sdf.ValueTypeNames.FloatArray, lambda r: Vt.FloatArray([r.random() for _ in range(r.choice((2, 2, 3)))])),
    "word": (Sdf.ValueTypeNames.Token, lambda r: r.choice("xyz")),
    "time": (Sdf.ValueTypeNames.TimeCode, lambda r: Sdf.TimeCode(r.randrange(9))),
    "file": (Sdf.ValueTypeNames.Asset, lambda r: Sdf.AssetPath(r.choice(("./clip.1.usda", "./gone.png")))),
    "turn": (Sdf.ValueTypeNames.Quatf, lambda r: Gf.Quatf(r.random(), r.random(), r.random(), r.random())),
}
CLIPS = 4  # clip.1.usda, ...
PRIMS = ("/Model", "/Model/Part", "/Model/Part/Piece")
TIMES = (-3, 0, 1, 2, 3, 4.5, 6, 8, 10, 12, 20)
OFFSETS = (Sdf.LayerOffset(),) * 3 + (Sdf.LayerOffset(2), Sdf.LayerOffset(0, 2), Sdf.LayerOffset(-1, 0.5))


class Maker:
    def __init__(self, seed, folder):
        self.r = random.Random(seed)
        self.folder = folder

    def chance(self, share):
        return self.r.random() < share

    def layer(self, name):
        path = os.path.join(self.folder, name)
        return Sdf.Layer.Find(path) or Sdf.Layer.CreateNew(path)

    def attribute(self, layer, prim, samples, default):
        r = self.r
        name = r.choice(sorted(VALUES))
        spec = Sdf.CreatePrimInLayer(layer, prim)
        kind, make = VALUES[name]
        variability = Sdf.VariabilityUniform if self.chance(0.08) else Sdf.VariabilityVarying
        attr = spec.attributes.get(name) or Sdf.AttributeSpec(spec, name, kind, variability)
        if self.chance(default):
            attr.default = Sdf.ValueBlock() if self.chance(0.1) else make(r)
        if self.chance(samples):
            for time in r.sample(TIMES, r.randint(1, 4)):
                layer.SetTimeSample(attr.path, time, Sdf.ValueBlock() if self.chance(0.08) else make(r))

    def pairs(self, most, times):
        r = self.r
        chosen = [r.choice(TIMES) for _ in range(r.randint(1, 5))]
        if not times:
            return Vt.Vec2dArray([(time, r.randrange(most)) for time in dict.fromkeys(chosen)])
        pairs = [(time, r.choice((time, time + 1, r.choice(TIMES)))) for time in sorted(chosen)]
        pairs = [pair for at, pair in enumerate(pairs) if at < 2 or pair[0] != pairs[at - 2][0]]
        if len(dict(pairs)) < len(pairs):  # jumps: pxr.Usd reads unset variables if no time of the stage shows a sample
            pairs = [(pairs[0][0] - 1, -10), *pairs, (pairs[-1][0] + 1, 120)]
            for at in range(1, len(pairs)):
                if pairs[at][0] == pairs[at - 1][0] and pairs[at][1] > pairs[at - 1][1]:
                    pairs[at - 1], pairs[at] = pairs[at], pairs[at - 1]
        return Vt.Vec2dArray(pairs)

    def info(self):
        """The dictionary of one clip set, or some keys of it."""
        r = self.r
        info = {}
        if self.chance(0.95):
            info["primPath"] = r.choice(("/Model",) * 12 + ("/Model/Part", "/Other", "Model", ""))
        if self.chance(0.2):
            info["templateAssetPath"] = r.choice(("./clip.#.usda", "./clip.##.usda"))  # pxr.Usd crashes on others
            info.update(templateStartTime=float(r.choice((0, 1))), templateEndTime=float(r.choice((3, 5))),
                        templateStride=r.choice((1.0, 2.0, 0.5)))
            if self.chance(0.3):
                info["templateActiveOffset"] = r.choice((0.5, -0.5))
        if self.chance(0.9):
            names = ["./clip.%d.usda" % r.randint(1, CLIPS) for _ in range(r.randint(1, 3))]
            if self.chance(0.05):
                names.append(r.choice(("./gone.usda", "")))
            info["assetPaths"] = Sdf.AssetPathArray([Sdf.AssetPath(name) for name in names])
            info["active"] = self.pairs(len(names) + self.chance(0.02), False)
        if self.chance(0.5):
            info["times"] = self.pairs(0, True)
        if self.chance(0.4):
            info["manifestAssetPath"] = Sdf.AssetPath(r.choice(("./manifest.usda",) * 4 + ("./gone.usda",)))
        if self.chance(0.4):
            info["interpolateMissingClipValues"] = self.chance(0.7)
        return info

    def clips(self, layer, prim):
        spec = Sdf.CreatePrimInLayer(layer, prim)
        clips = {name: self.info() for name in self.r.sample(("a", "b", "c"), self.r.choice((1, 1, 1, 2)))}
        spec.SetInfo("clips", clips)
        if self.chance(0.15):
            op = Sdf.StringListOp()
            names = self.r.sample(("a", "b", "c"), 2)
            setattr(op, self.r.choice(("prependedItems", "appendedItems", "deletedItems", "explicitItems")), names)
            spec.SetInfo("clipSets", op)

    def some_prim(self):
        return self.r.choice(PRIMS)

    def make(self):
        r = self.r
        for number in range(1, CLIPS + 1):
            clip = self.layer("clip.%d.usda" % number)
            for _ in range(r.randint(4, 12)):
                self.attribute(clip, self.some_prim(), 0.9, 0.3)
        manifest = self.layer("manifest.usda")
        for _ in range(20):
            self.attribute(manifest, self.some_prim(), 0.1, 0.4)
        asset, sub, root = self.layer("asset.usda"), self.layer("sub.usda"), self.layer("root.usda")
        for layer, prims in ((asset, 25), (sub, 1), (root, 1)):
            for prim in PRIMS:
                Sdf.CreatePrimInLayer(layer, prim).specifier = Sdf.SpecifierDef if layer == asset else Sdf.SpecifierOver
            for _ in range(prims):
                self.attribute(layer, self.some_prim(), 0.1 if layer == asset else 0.3, 0.15 if layer == asset else 0.4)
            if layer == asset or self.chance(0.2):
                self.clips(layer, r.choice(("/Model", "/Model", "/Model/Part")))
        root.subLayerPaths.append("./sub.usda")
        root.subLayerOffsets[0] = r.choice(OFFSETS)
        for number, name in enumerate(("One", "Two")):
            prim = Sdf.CreatePrimInLayer(root, "/" + name)
            prim.specifier = Sdf.SpecifierDef
            prim.referenceList.Prepend(Sdf.Reference("./asset.usda", "/Model", r.choice(OFFSETS)))
            prim.instanceable = number == 1 and self.chance(0.5)
            if self.chance(0.3):
                self.clips(root, prim.path)
            if self.chance(0.3):
                Sdf.CreatePrimInLayer(root, prim.path.AppendChild("Part")).inheritPathList.Prepend("/Model")
            for _ in range(r.choice((0, 0, 1))):
                self.attribute(root, r.choice(("/%s", "/%s/Part")) % name, 0.3, 0.5)
        root.startTimeCode, root.endTimeCode = r.choice(((-4, 3), (0, 5), (1, 9.5), (2, 4), (6, 30)))
        for layer in (asset, sub, root, manifest, *(self.layer("clip.%d.usda" % n) for n in range(1, CLIPS + 1))):
            layer.Save()
        return root


class Following(Follower):
    def __init__(self, seed, folder):
        base = os.path.join(folder, "clips%d" % seed)
        os.makedirs(base, exist_ok=True)
        self.maker = Maker(seed, base)
        self.root = self.maker.make()
        self.made = []
        self.clip_edited = False
        super().__init__(Usd.Stage.Open(self.root), base)

    def mute(self, identifier):
        self.made.append("mute or unmute")
        muted = [] if self.muted else [identifier]
        self.stage.MuteAndUnmuteLayers(muted, self.muted)
        self.ours.mute(muted)
        self.muted = muted

    def step(self):
        maker, r = self.maker, self.maker.r
        choice = r.random()
        self.clip_edited = choice < 0.4
        if choice > 0.93:
            self.mute(maker.layer("sub.usda").identifier)
            return
        if self.clip_edited:
            layer = maker.layer(r.choice(["clip.%d.usda" % n for n in range(1, CLIPS + 1)] + ["manifest.usda"]))
        else:
            layer = maker.layer(r.choice(("root.usda", "sub.usda", "asset.usda")))
        self.made.append(layer.GetDisplayName())
        if self.clip_edited or choice < 0.6:
            prim = maker.some_prim()
            spec = layer.GetPrimAtPath(prim)
            if spec and spec.attributes and r.random() < 0.3:
                self.made.append("no attribute of " + prim)
                spec.RemoveProperty(r.choice(list(spec.attributes.values())))
            else:
                self.made.append("attribute of " + prim)
                maker.attribute(layer, prim, 0.8, 0.3)
        else:
            prim = r.choice(("/Model", "/One", "/Model/Part"))
            spec = Sdf.CreatePrimInLayer(layer, prim)
            if spec.HasInfo("clips") and r.random() < 0.3:
                self.made.append("no clips of " + prim)
                spec.ClearInfo("clips")
            else:
                self.made.append("clips of " + prim)
                maker.clips(layer, prim)


def follow(seed, folder, steps):
    """(steps that were compared, what differs)."""
    following = Following(seed, folder)
    before = None
    for number in range(steps + 1):
        if number:
            following.made.clear()
            following.step()
        after = following.ours.dump(following.base)
        changes = [stage_following.together(one.changes()) for one in (following.ours, following.theirs)]
        found = list(itertools.islice(differences(shown(Dump(following.stage, following.base).all()), shown(after)), 4))
        if found and number:  # pxr.Usd does not follow its clips
            found = list(itertools.islice(differences(shown(following.anew()), shown(after)), 4))
        if number:
            found += ["missing: " + what for what in stage_following.missing(before, after, changes[0])]
            if not following.clip_edited:
                found += ["broader: " + what for what in stage_following.broader(before, after, *changes)]
        if found:
            return number, ["seed %d, step %d (%s): %s" % (seed, number, ", ".join(following.made), what) for what in found[:5]]
        before = after
    following.ours.close()
    return steps + 1, []


if __name__ == "__main__":
    stage_following.main(follow, 10)

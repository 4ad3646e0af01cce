"""A context for get_layers() that has a stage and nothing else of a UsdContext."""


class StageContext:
    def __init__(self, stage, name="test", live=None):
        self.stage, self.name, self.live = stage, name, live

    def get_stage(self):
        return self.stage

    def get_name(self):
        return self.name

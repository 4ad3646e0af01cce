import _usdlive_tree

_usdlive_tree.become(__name__)

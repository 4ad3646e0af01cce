"""Kit's modules under their own names: `usdlive.omni.usd`, `usdlive.omni.kit.app` and so on, so that scripts
written for Kit run on usdlive. The distribution in client/python/omni_shim installs them as `omni`."""

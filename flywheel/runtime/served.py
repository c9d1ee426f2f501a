"""The loader that MLflow models name which were logged before `tracking.pyfunc_model` had its place."""

from flywheel.runtime.tracking.pyfunc_model import _load_pyfunc

__all__ = ["_load_pyfunc"]

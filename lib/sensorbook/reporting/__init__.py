"""Reports: chapters executed by papermill, rendered by nbconvert, gathered into an index."""

import sys

# Where it is installed, jsonschema builds a grammar of addresses as it is imported, which takes longer
# than all the rest of nbformat, and nbformat has no use for it.
if "rfc3987_syntax" not in sys.modules:
    sys.modules["rfc3987_syntax"] = None
    try:
        import jsonschema  # noqa: F401
    finally:
        del sys.modules["rfc3987_syntax"]

"""Reports: chapters executed by papermill, rendered by nbconvert, gathered into an index."""

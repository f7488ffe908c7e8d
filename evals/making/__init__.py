"""Makes corpora from a workspace: requests in several styles, with ground truth by code."""

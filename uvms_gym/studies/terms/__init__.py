"""Terms of the model: cost of each per step, and error without it.

`scene_terms` lists the terms of a scene with the edits that remove them; `ablation` measures costs and errors.
"""

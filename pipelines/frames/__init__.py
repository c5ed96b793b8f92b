"""RGB-D frames in any layout: finding, reading, cameras, masks, workspaces."""

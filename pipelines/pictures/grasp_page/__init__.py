"""A frame's cloud, symmetries and grasps as one page with a 3D view in a browser (formats.md).

`cloud` and `scene` prepare the content, `page` puts it into HTML, and the `.js` files next to them
draw it with WebGL 2 alone.
"""

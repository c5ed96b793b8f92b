"""A frame's cloud, symmetries and grasps as one page to turn around in a browser (formats.md).

`cloud` and `scene` say what is drawn, `page` puts it into HTML, and the files `.js` beside them
draw it with WebGL 2 and nothing else.
"""

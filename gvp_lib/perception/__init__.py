"""From images to blobs. Thesis 2.1, shared by both planners.

Segmenters turn an image into a mask (``HsvThreshold``, ``Saliency``, ``BoxSegmenter``, or any function of your own);
``Blob`` holds a mask's moments, and ``Tracker`` follows one of several objects. ``images`` checks images and masks
where they enter the library, and crops and resizes what networks see.
"""

"""The names of the room, one a line: for type checkers, editors, and ``gvp_lib.lazy``."""

from gvp_lib.views import figures as figures
from gvp_lib.views.figures import COLORS as COLORS
from gvp_lib.views.figures import ThresholdSliders as ThresholdSliders
from gvp_lib.views.figures import draw_blob as draw_blob
from gvp_lib.views.figures import gallery as gallery
from gvp_lib.views.figures import hsv_histograms as hsv_histograms
from gvp_lib.views.figures import panels as panels
from gvp_lib.views.figures import pipeline as pipeline
from gvp_lib.views.figures import ratio_curve as ratio_curve
from gvp_lib.views.figures import show_images as show_images
from gvp_lib.views.figures import style as style
from gvp_lib.views.scene3d import Recording as Recording
from gvp_lib.views.scene3d import Scene3D as Scene3D

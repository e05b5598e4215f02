"""From photographs of an object on a printed sheet to views of it, as a robot's camera would have them.

A ``Sheet`` to print tells where a camera stood; ``views_from_photographs`` makes views of pictures from any telephone,
for every estimator of ``gvp_lib.planning``; and ``RecordedArm`` brings what a real arm saw, from a folder or a bag.
"""

from gvp_lib.photographs.desk import Photographs, views_from_photographs
from gvp_lib.photographs.recording import RecordedArm
from gvp_lib.photographs.sheet import Sheet

__all__ = ["Photographs", "RecordedArm", "Sheet", "views_from_photographs"]

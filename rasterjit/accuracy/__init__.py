"""
Measure what each accuracy setting costs in time and what it buys in error.

>>> import rasterjit as rj
>>> found = rj.accuracy.study(rj.load("models/teapot.obj"), budget=30, output="report")
>>> print(rj.accuracy.answer(found))
Take ... a frame...
"""

from rasterjit.accuracy.calibration import calibrate
from rasterjit.accuracy.choice import Choice, choose
from rasterjit.accuracy.many_scenes import FolderStudy, study_folder
from rasterjit.accuracy.report.files import can_make_page, write_files, write_report
from rasterjit.accuracy.results import EffectCost, Errors, Study, Trial
from rasterjit.accuracy.sentences import answer, sentences
from rasterjit.accuracy.study import study
from rasterjit.accuracy.test_scenes import MADE_FOR, SCENES, MadeScene, make

__all__ = [
    "MADE_FOR",
    "SCENES",
    "Choice",
    "EffectCost",
    "Errors",
    "FolderStudy",
    "MadeScene",
    "Study",
    "Trial",
    "answer",
    "calibrate",
    "can_make_page",
    "choose",
    "make",
    "sentences",
    "study",
    "study_folder",
    "write_files",
    "write_report",
]

"""Parameter files of AMCL, nav2's and ROS 1's: read, written and known by one table of its parameters."""

from pipeline.nav2.given import Given, given_in, is_amcl, nodes_in
from pipeline.nav2.launch import is_launch, values_of_launch
from pipeline.nav2.layout import Entry, Layout, given_of_layout, layout_of, lines_of, load
from pipeline.nav2.parameters import DEFAULTS, OF_EVERY_NODE, PARAMETERS, Parameter, kind_of
from pipeline.nav2.translating import OURS, Translation, in_our_words, translate
from pipeline.nav2.writing import fresh, written

__all__ = [
    "DEFAULTS",
    "OF_EVERY_NODE",
    "OURS",
    "PARAMETERS",
    "Entry",
    "Given",
    "Layout",
    "Parameter",
    "Translation",
    "fresh",
    "given_in",
    "given_of_layout",
    "in_our_words",
    "is_amcl",
    "is_launch",
    "kind_of",
    "layout_of",
    "lines_of",
    "load",
    "nodes_in",
    "translate",
    "values_of_launch",
    "written",
]

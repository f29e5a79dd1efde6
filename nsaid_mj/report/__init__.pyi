"""The door of `report`: what other houses may use."""

# Panels as figures of a page; one alone, without any `others`, is twice as wide.
from .drawings import figures_of as figures_of

# The exit code of a command.
from .exit_codes import ExitCode as ExitCode

# Counts side by side, such as how many parameters are identified.
from .page import Badges as Badges

# A cell of a table; a `Mark` becomes a badge.
from .page import Cell as Cell

# A drawing with its title and legend.
from .page import Figure as Figure

# Figures side by side; those beyond `most` are folded, under a title with their `kind`.
from .page import Figures as Figures

# Panels that are folded on a screen, and open on paper.
from .page import Fold as Fold

# A list; an entry is a text, or a pair of its subject and the rest.
from .page import Items as Items

# The results of a command.
from .page import Page as Page

# What a section of a page consists of: texts, lists, tables, figures, and what is folded.
from .page import PageItem as PageItem

# Panels below a title; without a title they form a separate card.
from .page import Section as Section

# A table.
from .page import Table as Table

# A paragraph; a `note` is small, and for the page only; a `head` is the title of the next.
from .page import Text as Text

# A number with its noun: 1 seed, 2 seeds, 0 seeds.
from .page import count as count

# Colour of what is wrong, such as a failed actuator.
from .panels import BAD as BAD

# Colours of curves on a light page.
from .panels import COLOURS as COLOURS

# Colour of grids.
from .panels import GRID as GRID

# Colour of lines and texts.
from .panels import INK as INK

# Index in `COLOURS`, and in a recording's palette, of a law's or method's colour on any plot.
from .panels import LAWS as LAWS

# A measured and a predicted quantity over time, and below it their difference.
from .panels import Comparison as Comparison

# Values with intervals, one line for each name.
from .panels import Forest as Forest

# Correlations as a heat map, below the diagonal.
from .panels import HeatMap as HeatMap

# Curves over time in one pair of axes.
from .panels import Panel as Panel

# Further values of a forest's lines.
from .panels import Points as Points

# Indices of at most about `most` of `length` rows, evenly spaced, including first and last.
from .panels import spread as spread

# The parameters of a result as tables of a page.
from .parameters import ParameterTables as ParameterTables

# The robot at positions q (m,) as a figure of a page; None without meshes, or finite q.
from .picture import robot_picture as robot_picture

# Makes plots whose legends stand beside the curves, in an empty part of the time axis.
from .recording.plots import Plots as Plots

# The camera of a 3D view, in world coordinates.
from .recording.scene import Camera as Camera

# Draws a robot into a recording, from shapes and poses only; it reads no true value.
from .recording.scene import Scene as Scene

# (k, j, 3) points (j, 3) or (k, j, 3) rotated by quaternions (k, 4) in x, y, z, w order.
from .recording.scene import rotated as rotated

# A recording that a viewer at an address shows while it is made.
from .recording.stream import live_recording as live_recording

# Writes a recording atomically.
from .recording.stream import write_recording as write_recording

# Replaces symbols and characters that the viewer's font lacks.
from .recording.text import drawable as drawable

# Whether the structure explains the motion: yes, partly, no.
from .result import Explains as Explains

# The display of a status or a verdict.
from .result import Mark as Mark

# One parameter of θ.
from .result import Parameter as Parameter

# The result of every command; a truth may be missing.
from .result import Result as Result

# A number for each of what is compared: identifiers, methods, laws, joints, experiments.
from .result import Statistic as Statistic

# A parameter's identifiability, in words.
from .result import Status as Status

# A pair of axes, and what is drawn in it, from the back to the front.
from .svg import Axes as Axes

# One of the two directions of axes.
from .svg import Side as Side

# Prints a page; the written files, or other last lines, come after a blank line.
from .terminal import print_page as print_page

# An estimate and its 95 % interval, rounded to two digits of the interval's half-width.
from .wording import estimate as estimate

# A share as a percentage; – for None.
from .wording import percent as percent

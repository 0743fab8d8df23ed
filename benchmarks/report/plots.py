"""Drawings in one style, as SVG to put into the page (or PNG, where there are very many points)."""

import base64
import io

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402

INK, DIM = "#1b2330", "#5c6773"
# Ours is always the same blue, the paper's method orange, the traditional one grey-green.
OURS, PAPER, PLANES, TRUTH, OTHER = "#1f5fbf", "#e08a1e", "#5f9e8f", "#9aa3ad", "#b0578d"
SERIES = [OURS, PAPER, PLANES, OTHER, "#8a6d3b", "#6f7fd0", "#c0504d", "#7f9f3f"]

plt.rcParams.update({
    "font.family": "sans-serif", "font.size": 10, "svg.fonttype": "path", "axes.edgecolor": DIM,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": DIM, "ytick.color": DIM,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e6e9ed",
    "axes.axisbelow": True, "legend.frameon": False, "axes.titlesize": 10.5,
    "axes.titleweight": "bold", "svg.hashsalt": "slf",
})  # fmt: skip


def figure(columns=1, rows=1, width=None, height=3.4, **options):
    """A figure and its axes, as plt.subplots gives them."""
    width = width or min(11.5, 0.8 + 5.2 * columns)
    return plt.subplots(
        rows, columns, figsize=(width, height * rows), constrained_layout=True, **options
    )


def svg(fig):
    buffer = io.StringIO()
    fig.savefig(buffer, format="svg", metadata={"Date": None})
    plt.close(fig)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def png(fig):
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=150)
    plt.close(fig)
    return f'<img src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">'

"""Figures: what they show, and that drawing is repeatable."""

import numpy as np
import pytest

from hgo_rs.errors import HgoError

pytest.importorskip("matplotlib")

from hgo_rs import plots
from hgo_rs.cli import report, reproduce
from hgo_rs.scenarios.base import row


def draw(figure):
    ax = figure.subplots()
    ax.plot(np.linspace(0.0, 1.0, 50), np.linspace(0.0, 1.0, 50) ** 2, label="$x^2$")
    ax.legend()


def test_equal_input_gives_equal_bytes():
    first, second = plots.render(draw), plots.render(draw)
    assert first["png"].startswith(b"\x89PNG")
    assert first["svg"].lstrip().startswith(b"<?xml")
    assert first == second


def test_the_style_ends_with_its_context():
    import matplotlib

    before = matplotlib.rcParams["axes.grid"], matplotlib.rcParams["font.size"]
    with plots.style():
        assert matplotlib.rcParams["axes.grid"] is True
    assert (matplotlib.rcParams["axes.grid"], matplotlib.rcParams["font.size"]) == before


@pytest.mark.parametrize(("n", "columns"), [(1, 1), (3, 1), (4, 1), (5, 2), (12, 2)])
def test_one_panel_a_state_and_one_for_the_innovation(n, columns):
    t = np.linspace(0.0, 10.0, 500)
    x_hat = np.cos(t[:, None] + np.arange(n))
    figure = plots.estimate_figure(t, x_hat, y=x_hat[:, 0], innovation=0.0 * t)
    axes = figure.get_axes()
    assert len(axes) == n + 1
    assert len({round(ax.get_position().x0, 2) for ax in axes}) == columns
    np.testing.assert_array_equal(axes[0].get_lines()[-1].get_ydata(), x_hat[:, 0])
    titles = [ax.get_title(loc="left") for ax in axes]
    assert titles.count("innovation") == 1
    assert len(set(titles)) == n + 1


def test_gain_is_drawn_if_it_moves():
    t = np.linspace(0.0, 1.0, 100)
    x_hat = np.zeros((100, 2))
    assert len(plots.estimate_figure(t, x_hat, gain=5.0).get_axes()) == 2
    assert len(plots.estimate_figure(t, x_hat, gain=0.0 * t + 5.0).get_axes()) == 2
    assert len(plots.estimate_figure(t, x_hat, gain=1.0 + t).get_axes()) == 3


def test_gaps_are_shaded():
    t = np.arange(10.0)
    missing = np.isin(np.arange(10), [2, 3, 9])
    figure = plots.estimate_figure(t, np.zeros((10, 1)), missing=missing)
    spans = figure.get_axes()[0].patches
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in spans] == [(2.0, 4.0), (9.0, 9.0)]


def test_a_start_up_peak_is_told_and_left_off_scale():
    t = np.linspace(0.0, 10.0, 1001)
    x_hat = np.c_[np.sin(t), np.where(t < 0.1, 4e3, np.cos(t))]
    axes = plots.estimate_figure(t, x_hat).get_axes()
    assert [len(ax.texts) for ax in axes] == [0, 1]
    assert "4e+03" in axes[1].texts[0].get_text()
    low, high = axes[1].get_ylim()
    assert -1.5 < low < -1.0 < 1.0 < high < 1.5


def test_shapes_that_do_not_fit():
    with pytest.raises(HgoError, match=r"3 times, 2 names for x_hat of shape \(4, 2\)"):
        plots.estimate_figure(np.arange(3.0), np.zeros((4, 2)))


def test_a_heavy_figure_goes_into_the_report_as_png():
    rows = (row("a", 1.0, at_most=2.0),)
    about = reproduce.about_this_run("numpy", 1, 1.0, 1)

    def page(svg):
        images = {"png": b"\x89PNG", "svg": svg}
        record = reproduce.Record("lee-x", "", "lee", "numpy", 1, rows, images=images)
        return report.build([record], about)

    assert "data:image/svg+xml;base64" in page(b"<svg/>")
    assert "data:image/png;base64" in page(b" " * (report.INLINE_SVG_LIMIT + 1))

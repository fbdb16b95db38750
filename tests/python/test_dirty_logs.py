"""Logs as text as the field writes them: read as the same signals, or refused with a remedy."""

import codecs
import datetime
import gzip
import io

import numpy as np
import pytest

from hgo_rs.logs import DataError, look, read_chunks, read_log, streams, write_table
from hgo_rs.logs.formats import tables

COUNT = 300
T = np.arange(COUNT) / 200
Q = np.round(np.sin(2.0 * T), 6)
ROWS = [f"{t:.3f},{q:.6f}" for t, q in zip(T, Q, strict=True)]
BEGIN = datetime.datetime(2024, 3, 5, 9, 7, 3)


def parted(delimiter, decimal="."):
    return [row.replace(",", delimiter).replace(".", decimal) for row in ROWS]


def stamped(write, origin=BEGIN):
    """Rows whose times are dates, as `write` writes them."""
    dates = [origin + datetime.timedelta(seconds=t) for t in T.tolist()]
    return [f"{write(date)},{q:.6f}" for date, q in zip(dates, Q, strict=True)]


def lines(*parts, end="\n"):
    return (
        end.join(row for part in parts for row in ([part] if isinstance(part, str) else part)) + end
    )


def read(tmp_path, data, time="t", output="q", name="log.csv", **options):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_log(path, time, output, **options)


def check(log, *told, first=0.0):
    np.testing.assert_allclose(log.t, first + T, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(log.y, Q)
    for words in told:
        assert any(words in remark for remark in log.remarks), (words, log.remarks)


def refusal(tmp_path, data, *args, **options):
    with pytest.raises(DataError) as caught:
        read(tmp_path, data, *args, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- heads -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (lines("t;q", parted(";", ",")), "decimal commas are read as points"),
        (lines("t\tq", parted("\t", ",")), "decimal commas are read as points"),
        (lines("t q", parted("  ", ",")), "decimal commas are read as points"),
        (lines("t|q", parted("|")), None),
        (lines("sep=;", "t;q", parted(";")), "passed over above the samples: line 1"),
        (lines("Logger X1", "Date;2024", "", "t;q", parted(";")), "samples: lines 1 to 2"),
        (lines("Device,X1", "Serial,12", "t,q", ROWS), "samples: lines 1 to 2"),
        (lines("Rate = 200 Hz", "# t, q", ROWS), "names are those of the comment in line 2"),
        (lines("% t q", parted(" ")), "names are those of the comment in line 1"),
        (lines("// t q", ROWS), "names are those of the comment in line 1"),
        (lines("#t,q", ROWS), "names are those of the comment in line 1"),
        (lines("t,q", "s,rad", ROWS), "line 2 is read as units (s, rad)"),
        (lines("t,q", "[s],[m/s^2]", ROWS), "line 2 is read as units"),
        (lines("t q", "--- ---", parted(" ")), "line 2 is read as units"),
        (lines("t,q,", ROWS), None),
        (lines("t,q", [row + "," for row in ROWS]), None),
        (lines("t,q,", [row + "," for row in ROWS]), None),
        (lines("t,q", ROWS, end="\r"), None),
        (lines("t,q", ROWS, end="\r\n"), None),
        (lines('"t","q"', ['"' + row.replace(",", '","') + '"' for row in ROWS]), None),
    ],
)
def test_heads(tmp_path, text, told):
    check(read(tmp_path, text), *filter(None, [told]))


def test_a_last_column_without_cells(tmp_path):
    """As LabVIEW's measurement files have it, with settings above that look like samples."""
    head = ["Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "t\tq\tComment"]
    text = lines(head, parted("\t"))
    check(read(tmp_path, text), "'Comment' is left out: no line has a cell below it")
    found = look(tmp_path / "log.csv")
    assert (found.time, found.output, found.rows) == ("t", "q", COUNT)
    assert "3 cells where 2" in refusal(tmp_path, text + "1.6\t0.1\tend\n")


@pytest.mark.parametrize(
    "above", [["Version;3,1"], ["Logger;X", "Rate;200", "Gain;1,5", "", "A;B;C"]]
)
def test_settings_above_the_names_are_no_samples(tmp_path, above):
    (tmp_path / "log.csv").write_text(lines(above, "t;q", parted(";", ",")))
    found = look(tmp_path / "log.csv")
    assert (found.time, found.output, found.rows) == ("t", "q", COUNT)


def test_a_row_of_units_says_the_unit_of_the_times(tmp_path):
    rows = [f"{5 * k},{q:.6f}" for k, q in enumerate(Q)]
    check(read(tmp_path, lines("t,q", "ms,rad", rows)))
    check(read(tmp_path, lines("t,q", "(ms),(deg)", rows), resets="split"))
    check(read(tmp_path, lines("t,q", ",rad", ROWS)))


def test_columns_by_their_places(tmp_path):
    for time, output in ((0, 1), ("0", "1"), (0, [1])):
        log = read(tmp_path, lines(ROWS), time, output)
        np.testing.assert_array_equal(log.y.ravel(), Q)
    check(read(tmp_path, lines("# t, q", ROWS), 0, 1))
    check(read(tmp_path, lines("# t, q", ROWS)))


# --- times -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("write", "begin"),
    [
        (datetime.datetime.isoformat, "09:07:03"),
        (str, "09:07:03"),
        (lambda d: d.isoformat() + "Z", "09:07:03"),
        (lambda d: d.isoformat() + "+01:00", "08:07:03"),
        (lambda d: d.isoformat() + "-0330", "12:37:03"),
        (lambda d: f"{d} UTC", "09:07:03"),
        (lambda d: d.strftime("%Y/%m/%d %H:%M:%S.%f"), "09:07:03"),
        (lambda d: d.strftime("%d.%m.%Y %H:%M:%S.%f"), "09:07:03"),
        (lambda d: f'"{d:%Y-%m-%d %H:%M:%S},{d:%f}"', "09:07:03"),
    ],
)
def test_dates(tmp_path, write, begin):
    log = read(tmp_path, lines("t,q", stamped(write)))
    check(log, f"t counts from t = 2024-03-05T{begin}.000000000")


@pytest.mark.parametrize("text", ["1969-12-31", "2000-02-29", "2024-12-31 23:59", "2199-03-01"])
def test_dates_are_numpys(tmp_path, text):
    path = tmp_path / "dates.csv"
    path.write_text(f"t,q\n{text},1\n")
    (table,) = tables(path, ["t", "q"], 10)
    assert table.columns["t"][0] == np.datetime64(text.replace(" ", "T"), "ns")


def test_times_of_day_go_on_over_midnight(tmp_path):
    rows = stamped(lambda d: d.strftime("%H:%M:%S.%f"), datetime.datetime(2024, 3, 5, 23, 59, 59))
    text = lines("t,q", rows)
    check(read(tmp_path, text), "times 't' continue over midnight (line 202)")
    for rows in (1, 7, 199, 200, 201):
        parts = list(read_chunks(tmp_path / "log.csv", "t", "q", rows=rows))
        np.testing.assert_allclose(np.concatenate([part.t for part in parts]), T, atol=1e-12)
    rows = [f"0 days 00:00:{t:09.6f},{q:.6f}" for t, q in zip(T, Q, strict=True)]
    check(read(tmp_path, lines("t,q", rows)))


def test_times_in_two_columns(tmp_path):
    whole, part = np.divmod(np.arange(COUNT) * 5_000_000, 10**9)
    rows = [f"{1_700_000_000 + a},{b},{q}" for a, b, q in zip(whole, part, Q, strict=True)]
    told = "t counts from sec + nanosec = 1700000000 s"
    check(read(tmp_path, lines("sec,nanosec,q", rows), "sec + nanosec"), told)
    check(read(tmp_path, lines("a,b,q", "s,ns,m", rows), "a+b"))
    check(read(tmp_path, lines("a+b,q", ROWS), "a+b"))
    late = datetime.datetime(2024, 3, 5, 23, 59, 59)
    rows = stamped(lambda d: d.strftime("%Y-%m-%d,%H:%M:%S.%f"), late)
    check(read(tmp_path, lines("date,time,q", rows), "date+time"), "2024-03-05T23:59:59")
    assert "unit of 'a' is unknown" in refusal(tmp_path, lines("a,b,q", "1,2,3", "2,3,4"), "a+b")
    text = lines("secs,nsecs,q", "0,0,1", "1.5,0,2")
    assert "'secs' must hold whole numbers" in refusal(tmp_path, text, "secs+nsecs")
    assert "no column 'secs'; nearest: nsecs, sec" in refusal(
        tmp_path, "sec,nsecs,q\n0,0,1\n", "secs+nsecs"
    )


@pytest.mark.parametrize("rows", [None, 1, 13])
def test_coarse_times_beside_a_period(tmp_path, rows):
    coarse = np.floor(10.0 * T) / 10.0
    text = lines("t,q", [f"{t:.1f},{q:.6f}" for t, q in zip(coarse, Q, strict=True)])
    check(
        read(tmp_path, text, dt=0.005),
        "times 't' have a resolution of only 0.1 s; samples are dt apart",
    )
    parts = list(read_chunks(tmp_path / "log.csv", "t", "q", dt=0.005, rows=rows))
    np.testing.assert_allclose(np.concatenate([part.t for part in parts]), T, atol=1e-12)
    told = "a resolution of only 0.1 s; give dt, the sampling period, on average 0.005 s"
    assert told in refusal(tmp_path, text)
    assert "is not sample" in refusal(tmp_path, text, dt=0.006)
    still = lines("t,q", [f"7,{q}" for q in Q])
    assert "is constant; leave it out, dt is enough" in refusal(tmp_path, still, dt=0.005)


# --- bytes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("encoding", "told"),
    [
        ("utf-8", None),
        ("utf-8-sig", None),
        ("utf-16", "read as UTF-16"),
        ("utf-16-le", "read as UTF-16"),
        ("utf-16-be", "read as UTF-16"),
        ("utf-32", "read as UTF-32"),
        ("cp1252", "not UTF-8: read as cp1252"),
        ("latin-1", "not UTF-8: read as cp1252"),
    ],
)
def test_encodings(tmp_path, encoding, told):
    text = lines("Zeit [µs];Winkel [°]", parted(";"), end="\r\n")
    options = {"time": "Zeit [µs]", "output": "Winkel [°]", "unit": "s"}
    log = read(tmp_path, text.encode(encoding), **options)
    check(log, *filter(None, [told]))
    packed = gzip.compress(text.encode(encoding))
    check(read(tmp_path, packed, name="log.csv.gz", **options))
    check(read(tmp_path, packed, **options))


@pytest.mark.parametrize(
    ("encoding", "time", "output"),
    [
        ("cp1250", "čas", "úhel"),
        ("cp1251", "время", "угол"),
        ("koi8-r", "время", "угол"),
        ("mac-roman", "Zeit", "Höhe °"),
        ("cp437", "Zeit", "Höhe °"),
        ("shift_jis", "時間", "角度"),
        ("gbk", "时间", "角度"),
        ("euc-kr", "시간", "각도"),
        ("big5", "時間", "高度"),
    ],
)
def test_the_names_that_are_asked_for_tell_the_encoding(tmp_path, encoding, time, output):
    data = lines(f"{time};{output}", parted(";")).encode(encoding)
    log = read(tmp_path, data, time, output)
    np.testing.assert_array_equal(log.y, Q)
    assert any("in which it holds the names" in remark for remark in log.remarks)
    assert "not UTF-8: read as " in refusal(tmp_path, data, time, output + "ß")


def test_a_mark_of_utf_8_above_other_bytes(tmp_path):
    data = codecs.BOM_UTF8 + lines("t;Winkel [°]", parted(";")).encode("latin-1")
    check(read(tmp_path, data, output="Winkel [°]"), "not UTF-8: read as cp1252")


def test_standard_input_may_be_read_again(tmp_path, monkeypatch):
    data = io.TextIOWrapper(io.BytesIO(lines("t,q", ROWS).encode()))
    monkeypatch.setattr("sys.stdin", data)
    monkeypatch.setattr(streams, "_spool", [])
    for _ in range(2):
        check(read_log("-", "t", "q"))


def test_bytes_that_are_no_log(tmp_path):
    good = lines("t,q", ROWS).encode()
    cases = [
        (b"PK\x03\x04" + bytes(99), "is not text but a zip archive"),
        (b"PAR1" + bytes(99), "is not text but Parquet: call it .parquet"),
        (b"<!DOCTYPE html>\n<table>", "holds HTML or XML: save it as CSV"),
        (b'{"t": 0.0, "q": 1.0}\n', "holds JSON: write it as CSV"),
        (b'[{"t": 0.0}]', "holds JSON"),
        (
            good + bytes(len(good)),
            "line 302: holds bytes that are no text; remove the line, or cut",
        ),
        (good + b"1.500,-", "column 'q': '-' is not a number; the file is cut off there: remove"),
        (bytes(range(256)) * 99, "holds bytes that are no text"),
        (gzip.compress(good)[:-900], "the packed log is cut off"),
        (good + bytes(50), "line 302: holds bytes that are no text; remove the line, or cut"),
        (good[:-12], "line 301: 1 cell where 2 cells are expected; the file is cut off there"),
        (good[:19], "1 samples; an observer needs at least 2"),
        (b"t,q\n", "0 samples; an observer needs at least 2"),
    ]
    for data, told in cases:
        assert told in refusal(tmp_path, data), told


# --- cells -----------------------------------------------------------------------------------

WORDS = ["#N/A", "-nan(ind)", "NaN", "<NA>", "1.#QNAN", "-1.#IND", "NULL", "NaT", "n/a", "#NV", ""]


@pytest.mark.parametrize("word", WORDS)
def test_words_for_missing_samples(tmp_path, word):
    log = read(tmp_path, lines("q,t", [f"{word},0.0", "1,0.1", f"{word},0.2", "3,0.3"]))
    np.testing.assert_array_equal(log.missing, [True, False, True, False])


@pytest.mark.parametrize(
    ("cell", "told"),
    [
        ("0x1F", "it is hexadecimal: convert it to decimal, for example by int(cell, 16)"),
        ("1f3a", "it is hexadecimal"),
        ("0b101", "convert it to decimal, for example by int(cell, 0)"),
        ("12.5 V", "write 12.5 and the unit V into the header"),
        ("5ms", "write 5 and the unit ms into the header"),
        ("1,234.5", "write it without separators of thousands"),
        ("1 234", "write it without separators of thousands"),
        ("1.5D+03", "write the exponent with E"),
        ("TRUE", "write 1 or 0"),
        ("1_000", "write it without underscores"),
        ("--", "write a number, or leave the cell of a missing sample empty"),
        ("#VALUE!", "write a number, or leave the cell of a missing sample empty"),
        ("05-Mar-2024 09:07:03", "write 2024-03-05 21:07:03, or seconds"),
        ("5. Okt. 2024", "write 2024-03-05 21:07:03, or seconds"),
        ("Mar  5 09:07:03", "write 2024-03-05 21:07:03, or seconds"),
        ("Tue, 05 Mar 2024 09:07:03 GMT", "write 2024-03-05 21:07:03, or seconds"),
        ("20240305T090703.25Z", "write 2024-03-05 21:07:03, or seconds"),
        ("12.5 mars", "write 12.5 and the unit mars into the header"),
        ("'1.5'", "write the bare number, without signs around it"),
        ("=1.5", "write the bare number, without signs around it"),
        ("\u22121.5", "write its minus as -"),
        ("1.#INF", "leave the cell of a missing sample empty"),
        ("∞", "leave the cell of a missing sample empty"),
        ("1.5 # kick", "remove the comment behind the number"),
        ("2024-03-05 09:07:03", "write all as 2024-03-05T09:07:03.25, or as seconds"),
    ],
)
def test_cells_that_hold_something_else_are_told_with_a_remedy(tmp_path, cell, told):
    message = refusal(tmp_path, lines("t;q", "0;1", f"1;{cell}"))
    assert f"line 3, column 'q': {cell!r} is not a number; {told}" in message


def test_dates_that_are_told_with_a_remedy(tmp_path):
    us = stamped(lambda d: d.strftime("%m/%d/%Y %I:%M:%S %p"))
    assert "pandas.to_datetime reads other dates" in refusal(tmp_path, lines("t,q", us))
    mixed = stamped(str)[:9] + stamped(lambda d: f"{d}Z")[9:]
    told = "line 11, column 't': '2024-03-05 09:07:03.045000Z' differs from earlier dates"
    assert told in refusal(tmp_path, lines("t,q", mixed))
    assert "'2024-02-30' is not a date" in refusal(tmp_path, "t,q\n2024-02-01,1\n2024-02-30,2\n")


def test_lines_that_are_no_samples(tmp_path):
    for name, told in (
        ("log.csv.xz", "unknown format '.xz'; unpack it"),
        ("log.xls", "unknown format '.xls'; save it as .xlsx or .csv"),
        ("log.lvm", "unknown format '.lvm'; text may be called .txt"),
    ):
        assert told in refusal(tmp_path, lines("t,q", ROWS), name=name)
    assert "remove the row, or give dt" in refusal(tmp_path, "t,q\n0,1\n,2\n1,3\n")
    again = lines("t,q", ROWS[:9], "t,q", ROWS)
    assert "line 11 repeats the header (t,q); cut the log there" in refusal(tmp_path, again)
    commas = lines("t,q", [row.replace(".", ",") for row in ROWS])
    told = (
        "line 2: 4 cells where 2 cells are expected; where commas are decimal signs, part the cells"
    )
    assert told in refusal(tmp_path, commas)
    names = lines("t,q", "first,second", ROWS)
    assert "remove the line if it holds units or names" in refusal(tmp_path, names)


# --- out -------------------------------------------------------------------------------------


def test_written_numbers_have_their_bits(tmp_path):
    rng = np.random.default_rng(7)
    bits = rng.integers(0, 2**64, 20_000, dtype=np.uint64).view(np.float64)
    special = [0.0, -0.0, 5e-324, 1.7976931348623157e308, 1e16, 0.1, 123456789.0, -1e-5]
    values = np.concatenate([bits[np.isfinite(bits)], special])
    path = tmp_path / "out.csv"
    counts = np.arange(len(values)) - 5
    write_table(path, {"t": np.arange(len(values)) * 1.0, "a, b": values, "n": counts})
    cells = [line.split(",") for line in path.read_text().splitlines()[1:]]
    told = np.array([float(row[1]) for row in cells])
    np.testing.assert_array_equal(told.view(np.int64), values.view(np.int64))
    assert [int(row[2]) for row in cells] == counts.tolist()
    log = read_log(path, "t", "a, b")
    np.testing.assert_array_equal(log.y.view(np.int64), values.view(np.int64))
    with pytest.raises(DataError, match=r"columns differ in length \(t: 2, q: 3\)"):
        write_table(path, {"t": np.zeros(2), "q": np.zeros(3)})

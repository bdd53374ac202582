// CSV files that the user saves, for `sonarmap map` to read.

/** A text without halves of characters, which UTF-8 cannot say: as their numbers, as Python's backslashreplace has them. */
function wellFormed(text) {
  const half = /[\ud800-\udbff](?![\udc00-\udfff])|(?<![\ud800-\udbff])[\udc00-\udfff]/g;
  return String(text).replace(half, (unit) => `\\u${unit.charCodeAt(0).toString(16)}`);
}

/** A text on one line. */
function oneLine(text) {
  return wellFormed(text).replace(/[\x00-\x1f\x7f\x85\u2028\u2029]/g, " ").trim();
}

/**
 * A cell: with an apostrophe before what a spreadsheet would take for a formula, as tools/files/readers/csv_table.py has it, and in quotes
 * where it must be: some divide cells at semicolons, and a line that began with # would be a comment.
 */
function cellOf(value) {
  let text = oneLine(value ?? "");
  if (/^'*[=+\-@\uff1d\uff0b\uff0d\uff20]/.test(text) && !Number.isFinite(Number(text)))
    text = `'${text}`;
  return /[",;]|^#/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** A comment in a line, a heading, and rows: {column: value} each, of which none is empty. */
function csvOf(comment, columns, rows) {
  const line = (cells) => cells.map(cellOf).join(",");
  const lines = [`# ${oneLine(comment).replace(/[,;"]/g, " ")}`, line(columns), ...rows.map((row) => line(columns.map((name) => row[name])))];
  return `${lines.join("\n")}\n`;
}

/** Have the browser save a text as a file in UTF-8. */
function saveFile(name, text) {
  const url = URL.createObjectURL(new Blob([text], { type: "text/csv;charset=utf-8" }));
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

// The table of shapes: sorted by a click on a heading, filtered by words, comparisons and verdicts.
const VERDICTS = ["certain", "likely", "unsure", "same", "different", "failed"];
const HEADINGS = [...document.querySelectorAll("#shapes th[data-key]")];
const COLUMNS = Object.fromEntries(HEADINGS.map((heading) => [heading.dataset.key, heading.cellIndex]));
const NAMES = { "χ": "euler", chi: "euler", loops: "boundary_loops", boundary: "boundary_loops" };
const COMPARISON = /^([\wχ]+)(<=|>=|!=|=|<|>)(.+)$/;

export class Table {
  constructor(rows) {
    this.rows = rows;
    this.hidden = new Set();
    this.body = document.querySelector("#shapes tbody");
    this.input = document.getElementById("filter");
    this.input.addEventListener("input", () => this.refresh());
    for (const heading of HEADINGS)
      heading.addEventListener("click", () => this.sort(heading));
    for (const row of rows) {
      const open = () => (location.hash = row.id.replace("row", "shape"));
      row.addEventListener("click", open);
      row.addEventListener("keydown", (event) => event.key === "Enter" && open());
    }
    this.addVerdicts();
    this.refresh();
  }

  addVerdicts() {
    for (const verdict of VERDICTS) {
      const count = this.rows.filter((row) => row.dataset.verdict === verdict).length;
      if (!count) continue;
      const button = document.createElement("button");
      button.className = `verdict ${verdict}`;
      button.textContent = `${count} ${verdict}`;
      button.ariaPressed = "true";
      button.addEventListener("click", () => {
        const shown = this.hidden.delete(verdict);
        if (!shown) this.hidden.add(verdict);
        button.ariaPressed = String(shown);
        this.refresh();
      });
      document.getElementById("verdicts").append(button);
    }
  }

  visible() {
    return [...this.body.querySelectorAll("tr:not([hidden])")];
  }

  refresh() {
    const words = this.input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of this.rows)
      row.hidden = this.hidden.has(row.dataset.verdict) || !words.every((word) => matches(row, word));
    const count = this.visible().length;
    document.getElementById("shown").textContent = `${count} of ${this.rows.length} shown`;
  }

  sort(heading) {
    const down = heading.ariaSort === "ascending";
    for (const other of document.querySelectorAll("#shapes th")) other.ariaSort = null;
    heading.ariaSort = down ? "descending" : "ascending";
    const column = heading.cellIndex;
    const sorted = [...this.rows].sort((a, b) => compare(cell(a, column), cell(b, column), down ? -1 : 1));
    this.body.append(...sorted);
  }
}

const cell = (row, column) => row.cells[column].textContent.trim();

// Numbers by size, texts by letters; empty cells last in either direction.
function compare(a, b, sign) {
  if (a === "" || b === "") return (a === "") - (b === "");
  const difference = Number(a) - Number(b);
  return sign * (Number.isNaN(difference) ? a.localeCompare(b, undefined, { numeric: true }) : difference);
}

function matches(row, word) {
  const [, left, sign, right] = COMPARISON.exec(word) ?? [];
  const column = COLUMNS[NAMES[left] ?? left];
  if (column === undefined) return row.textContent.toLowerCase().includes(word);
  const value = cell(row, column).toLowerCase();
  if (value === "") return false;
  const [a, b] = Number.isNaN(Number(right)) ? [value, right] : [Number(value), Number(right)];
  return { "<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b, "=": a === b, "!=": a !== b }[sign];
}

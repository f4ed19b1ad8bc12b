// Tables with small lines over time: draws the lines, filters and sorts the rows. Without it the table has one small
// line a row.

const SPARK = { width: 60, height: 22 };

function spark([first, last], days, values, since, parent) {
  const space = "http://www.w3.org/2000/svg";
  const add = (tag, attributes) => {
    const element = document.createElementNS(space, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    drawing.append(element);
  };
  const drawing = document.createElementNS(space, "svg");
  const { width, height } = SPARK;
  const across = (day) => (3 + ((width - 6) * (day - first)) / (last - first || 1)).toFixed(1);
  const up = (value) => ((height / 2) * (1 - 0.9 * value)).toFixed(1);
  drawing.setAttribute("width", width);
  drawing.setAttribute("height", height);
  drawing.setAttribute("aria-hidden", "true");
  add("line", { x1: 0, x2: width, y1: height / 2, y2: height / 2, class: "middle" });
  if (since != null) add("line", { x1: across(since), x2: across(since), y1: 0, y2: height, class: "since" });
  const points = days.map((day, k) => [day, values[k]]).filter(([, value]) => value != null);
  if (points.length > 1) add("polyline", { points: points.map(([day, value]) => `${across(day)},${up(value)}`).join(" ") });
  if (points.length && points.length < 15)
    for (const [day, value] of points) add("circle", { cx: across(day), cy: up(value), r: 1.6 });
  parent.append(drawing);
}

/** A cause in words; a symbol as it is. */
const words = ({ name }) => (name.length > 8 ? name.replaceAll("_", " ") : name);

class Grid {
  constructor(root) {
    this.table = root.querySelector("table");
    this.body = this.table.tBodies[0];
    this.content = JSON.parse(root.querySelector("script").textContent);
    this.rows = [...this.body.rows].map((element, index) => ({ element, index, ...this.read(this.content.rows[index]) }));
    root.classList.add("drawn");
    // The last column of the file has one small line a row, for print.
    this.texts = this.table.tHead.rows[0].cells.length - 1;
    this.addControls(root);
    this.addColumns();
    this.addSorting();
    this.show();
  }

  /** Values of each column, as shares of its range; null where there is none. */
  read(row) {
    const bytes = Uint8Array.from(atob(row.codes), (letter) => letter.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const values = this.content.columns.map((_, column) => row.days.map((_, k) => {
      const code = view.getInt16(2 * (column * row.days.length + k), true);
      return code === -32768 ? null : code / 32767;
    }));
    return { ...row, values };
  }

  addControls(root) {
    const bar = document.createElement("div");
    bar.className = "switches";
    const label = make("label", bar, "Rows with ");
    this.search = make("input", label);
    this.search.type = "search";
    this.search.addEventListener("input", () => this.show());
    this.choice = make("select", bar);
    this.choice.setAttribute("aria-label", "State");
    make("option", this.choice, "all");
    for (const [state, words] of Object.entries(this.content.states)) {
      const option = make("option", this.choice, words);
      option.value = `state ${state}`;
    }
    this.choice.addEventListener("change", () => this.show());
    this.count = make("span", bar);
    this.count.setAttribute("aria-live", "polite");
    this.readout = document.createElement("p");
    this.readout.className = "readout";
    root.prepend(bar, this.readout);
    this.tell(null);
  }

  addColumns() {
    const head = this.table.tHead.rows[0];
    for (const column of this.content.columns) {
      const cell = make("th", head, words(column), "spark");
      cell.scope = "col";
    }
    for (const row of this.rows) {
      row.values.forEach((values, column) => {
        const cell = make("td", row.element, "", "spark");
        const hit = row.marked === column;
        if (hit) cell.classList.add("hit");
        spark(this.content.period, row.days, values, hit ? row.since : null, cell);
        cell.addEventListener("pointerenter", () => this.tell(row, column));
      });
      row.element.addEventListener("pointerleave", () => this.tell(null));
    }
  }

  /** The numbers of a cell, above the table. */
  tell(row, column) {
    this.readout.textContent = "Each small line: deviation from the middle of the fleet over time, one scale for each column. Point at one to read it.";
    if (!row) return;
    const { name, unit, middle, range } = this.content.columns[column];
    const known = row.values[column].filter((value) => value != null).map((value) => middle + range * value);
    const reach = (value) => `${figure4(value)} ${unit}`.trim();
    const said = known.length ? `from ${reach(known[0])} to ${reach(known[known.length - 1])}` : "not determined";
    this.readout.textContent = `${row.element.cells[0].textContent}, ${words({ name })}: ${said}`;
  }

  addSorting() {
    [...this.table.tHead.rows[0].cells].forEach((cell, index) => {
      if (index === this.texts) return;
      const heading = cell.textContent;
      cell.textContent = "";
      const button = make("button", cell, heading, "sort");
      button.type = "button";
      button.addEventListener("click", () => this.sort(cell, index));
    });
  }

  /** By a text or number; by the largest change of a column of small lines. A second click turns the order. */
  sort(cell, index) {
    const down = cell.getAttribute("aria-sort") === "ascending" || (index > this.texts && !cell.hasAttribute("aria-sort"));
    for (const other of this.table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    cell.setAttribute("aria-sort", down ? "descending" : "ascending");
    const key = (row) => {
      if (index > this.texts) {
        const known = row.values[index - this.texts - 1].filter((value) => value != null);
        return known.length ? Math.max(...known) - Math.min(...known) : null;
      }
      const text = row.element.cells[index].textContent.trim();
      return text === "" ? null : Number.isNaN(Number(text)) ? text : Number(text);
    };
    const keys = new Map(this.rows.map((row) => [row, key(row)]));
    const order = [...this.rows].sort((one, other) => {
      const [a, b] = [keys.get(one), keys.get(other)];
      // Rows without a value are last, whichever the order.
      if (a == null || b == null) return (a == null) - (b == null) || one.index - other.index;
      const sign = typeof a === typeof b && typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b;
      return (down ? -sign : sign) || one.index - other.index;
    });
    this.body.append(...order.map((row) => row.element));
  }

  show() {
    const sought = this.search.value.trim().toLowerCase();
    const state = this.choice.value.startsWith("state ") ? this.choice.value.slice(6) : null;
    let count = 0;
    for (const row of this.rows) {
      const texts = [...row.element.cells].slice(0, this.texts).map((cell) => cell.textContent).join(" ").toLowerCase();
      const shown = (state == null || row.state === state) && texts.includes(sought);
      row.element.hidden = !shown;
      count += shown;
    }
    this.count.textContent = `${count} of ${this.rows.length}`;
  }
}

document.querySelectorAll(".grid").forEach((root) => new Grid(root));

// The page: a table of shapes, and a view of the one that the address names.
import { Table } from "./table.js";
import { Viewer } from "./viewer.js";
import { unpack } from "./unpack.js";

const byId = (id) => document.getElementById(id);
const rows = [...document.querySelectorAll("#shapes tbody tr")];
const table = new Table(rows);
let viewer = null;
let current = 0;
let drawn = Promise.resolve(); // when the shape that was asked for last is in view

function step(link, row) {
  link.hidden = rows.length < 2;
  if (row) link.href = `#${row.id.replace("row", "shape")}`;
  else link.removeAttribute("href");
}

async function show(number) {
  current = number;
  byId("list").hidden = number > 0;
  byId("shape").hidden = number === 0;
  for (const id of ["filter", "verdicts", "shown"]) byId(id).hidden = number > 0 || rows.length < 2;
  if (number === 0) return;
  const row = byId(`row-${number}`);
  byId("heading").textContent = row.querySelector(".name").textContent;
  byId("details").replaceChildren(byId(`details-${number}`).content.cloneNode(true));
  byId("back").hidden = rows.length < 2;
  const visible = table.visible();
  const place = visible.indexOf(row);
  step(byId("previous"), visible[place - 1]);
  step(byId("next"), visible[place + 1]);
  const packed = byId(`scene-${number}`);
  const scene = packed ? await unpack(packed.textContent) : null;
  if (number !== current) return; // another shape was asked for meanwhile
  byId("message").textContent = scene ? "" : "There is no 3D view of this shape.";
  draw(scene);
}

function draw(scene) {
  if (!viewer && scene) {
    try {
      viewer = new Viewer(byId("canvas"), byId("tools"), byId("legend"));
    } catch (error) {
      byId("message").textContent = `This browser cannot show 3D graphics (${error.message}).`;
    }
  }
  viewer?.show(scene);
}

byId("details").addEventListener("click", async (event) => {
  const row = event.target.closest("tr.place");
  if (!row) return;
  await drawn; // a place can be clicked before its shape is unpacked
  if (!row.isConnected || !viewer?.marks) return;
  for (const other of byId("details").querySelectorAll(".chosen")) other.classList.remove("chosen");
  row.classList.add("chosen");
  if (row.dataset.mark !== undefined) viewer.findMark(Number(row.dataset.mark));
  else viewer.findBox(...[row.dataset.low, row.dataset.high].map((text) => text.split(",").map(Number)));
});

const wanted = () => Number(/^#shape-(\d+)$/.exec(location.hash)?.[1] ?? 0);
const open = () => {
  const number = rows.length === 1 ? 1 : wanted();
  drawn = show(number <= rows.length ? number : 0);
};
window.addEventListener("hashchange", open);
window.addEventListener("keydown", (event) => {
  if (event.target.tagName === "INPUT" || current === 0) return;
  const link = { ArrowLeft: "previous", ArrowRight: "next", Escape: "back" }[event.key];
  if (link && byId(link).href && !byId(link).hidden) location.hash = new URL(byId(link).href).hash;
});
open();

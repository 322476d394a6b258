// The 3D view: a surface or discs colored by curvature, lines that mark places, and a camera that finds them.
import {
  AmbientLight, Box3, Box3Helper, DirectionalLight, PerspectiveCamera, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Body } from "./body.js";
import { Marks } from "./marks.js";

const START = { z: new Vector3(0.9, -1.3, 0.8), y: new Vector3(0.9, 0.8, 1.3) };
const FLIGHT = 450; // milliseconds that the camera takes to a place
const NEAREST = 0.25; // distance from a tiny place, in sizes of the shape

export class Viewer {
  constructor(canvas, tools, legend) {
    this.canvas = canvas;
    this.legend = legend;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.camera = new PerspectiveCamera(32, 1, 0.01, 50);
    this.world = new Scene();
    const lamp = new DirectionalLight(0xffffff, 2.2);
    lamp.position.set(-0.5, 0.8, 1);
    const fill = new DirectionalLight(0xffffff, 0.6);
    fill.position.set(1, -0.3, 0.6);
    this.camera.add(lamp, fill, lamp.target, fill.target);
    this.world.add(this.camera, new AmbientLight(0xffffff, 1.1));
    this.up = "z";
    this.makeControls();
    this.addTools(tools);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    canvas.addEventListener("webglcontextrestored", () => this.draw());
  }

  makeControls() {
    this.controls?.dispose();
    this.camera.up.set(0, Number(this.up === "y"), Number(this.up === "z"));
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
  }

  addTools(tools) {
    const add = (text, title, action) => {
      const button = Object.assign(document.createElement("button"), { textContent: text, title });
      button.addEventListener("click", () => action(button));
      tools.append(button);
      return button;
    };
    this.glass = add("See through", "Make the surface transparent", () => this.setTransparent(!this.isTransparent));
    add("Colors", "Colors, or gray", (button) => {
      button.ariaPressed = String(this.body?.toggleColors() ?? false);
      this.draw();
    });
    add("Up: z", "Which axis points up", (button) => {
      this.up = this.up === "z" ? "y" : "z";
      button.textContent = `Up: ${this.up}`;
      this.makeControls();
      this.home();
    });
    add("Whole", "Show the whole shape", () => {
      this.clearChoice();
      this.setTransparent(false);
      this.home();
    });
  }

  show(scene) {
    for (const part of [this.body, this.marks]) part?.remove();
    this.body = this.marks = null;
    this.clearChoice();
    this.legend.hidden = this.canvas.hidden = !scene;
    if (!scene) return;
    this.scene = scene;
    this.body = new Body(scene, this.world);
    this.marks = new Marks(scene, this.world);
    this.showLegend(scene.legend);
    this.setTransparent(false);
    this.resize();
    this.home();
  }

  showLegend([title, ...words]) {
    const text = (value) => Object.assign(document.createElement("span"), { textContent: value });
    const ends = document.createElement("div");
    ends.className = "ends";
    ends.append(...words.map(text));
    const scale = document.createElement("div");
    scale.className = "scale";
    this.legend.replaceChildren(text(title), scale, ends);
  }

  home() {
    this.flight = null;
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(START[this.up]).setLength(this.distance(this.body?.radius ?? 0.8));
    this.controls.update();
    this.report();
    this.draw();
  }

  distance(radius) {
    const half = (this.camera.fov * Math.PI) / 360;
    return (1.08 * radius) / Math.sin(Math.atan(Math.tan(half) * Math.min(1, this.camera.aspect)));
  }

  // Center a mark that the table names, and light it up.
  findMark(index) {
    this.clearChoice();
    this.setTransparent(true);
    const box = this.marks.choose(index);
    this.canvas.dataset.chosen = String(index);
    this.fly(box);
  }

  // Center a box, given by its corners in units of the shape, and draw it.
  findBox(low, high) {
    this.clearChoice();
    const local = (corner) => new Vector3(...corner.map((x, axis) => this.body.place(x, axis)));
    const box = new Box3(local(low), local(high));
    this.frame = new Box3Helper(box, 0x2158a8);
    this.world.add(this.frame);
    this.fly(box);
  }

  clearChoice() {
    this.marks?.choose(null);
    if (this.frame) this.world.remove(this.frame);
    this.frame = null;
    delete this.canvas.dataset.chosen;
  }

  fly(box) {
    const target = box.getCenter(new Vector3());
    const radius = Math.max(box.getSize(new Vector3()).length() / 2, NEAREST / 2);
    const away = this.camera.position.clone().sub(this.controls.target);
    const from = [this.controls.target.clone(), away.length()];
    const to = [target, Math.min(this.distance(1.6 * radius), this.distance(this.body.radius))];
    away.normalize();
    const began = performance.now();
    const frame = (now) => {
      if (this.flight !== frame) return; // the camera was sent elsewhere
      const share = Math.min(1, Math.max(0, (now - began) / FLIGHT));
      const eased = share * share * (3 - 2 * share);
      this.controls.target.lerpVectors(from[0], to[0], eased);
      const length = from[1] + (to[1] - from[1]) * eased;
      this.camera.position.copy(this.controls.target).addScaledVector(away, length);
      this.controls.update();
      this.draw();
      if (share < 1) requestAnimationFrame(frame);
      else this.report();
    };
    this.flight = frame;
    requestAnimationFrame(frame);
  }

  // Where the camera looks, in units of the shape, for whoever asks the page.
  report() {
    const at = this.controls.target.toArray().map((x, axis) => this.body?.length(x, axis));
    this.canvas.dataset.target = at.join(",");
  }

  setTransparent(wanted) {
    this.isTransparent = wanted;
    this.glass.ariaPressed = String(wanted);
    this.body?.setTransparent(wanted);
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.marks?.resize(width, height);
    this.draw();
  }

  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.renderer.render(this.world, this.camera);
    });
  }
}

// Makes the surroundings that shiny materials reflect: a soft room with a bright ceiling and two lamps.
import {
  BackSide,
  BoxGeometry,
  FrontSide,
  Mesh,
  MeshBasicMaterial,
  PMREMGenerator,
  Scene,
  SphereGeometry,
  type Texture,
  type WebGLRenderer,
} from "three";

/** The up axis of the room is Y, as three.js wants it for an environment. */
export function makeEnvironment(renderer: WebGLRenderer): Texture {
  const scene = new Scene();
  const add = (
    geometry: BoxGeometry | SphereGeometry,
    brightness: number,
    place: [number, number, number],
    isRoom = false,
  ) => {
    const material = new MeshBasicMaterial({ side: isRoom ? BackSide : FrontSide });
    material.color.setScalar(brightness);
    const mesh = new Mesh(geometry, material);
    mesh.position.set(...place);
    scene.add(mesh);
  };
  add(new SphereGeometry(20, 16, 8), 0.32, [0, 0, 0], true);
  add(new BoxGeometry(18, 0.5, 18), 1.5, [0, 14, 0]);
  add(new BoxGeometry(0.5, 9, 9), 3.5, [14, 4, 4]);
  add(new BoxGeometry(9, 7, 0.5), 2, [-6, 5, -15]);
  add(new BoxGeometry(40, 0.5, 40), 0.12, [0, -12, 0]);
  const generator = new PMREMGenerator(renderer);
  const { texture } = generator.fromScene(scene, 0, 0.1, 100, { size: 64 });
  generator.dispose();
  for (const object of scene.children) if (object instanceof Mesh) object.geometry.dispose();
  return texture;
}

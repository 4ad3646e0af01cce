// Starts the page.
import { render } from "preact";

render(<p>usdlive</p>, document.getElementById("page") as HTMLElement);

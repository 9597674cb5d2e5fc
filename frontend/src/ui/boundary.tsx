import { Button } from "@mantine/core";
import { Component, type ReactNode } from "react";
import { StateBox } from "./notice";

interface BoundaryState {
  broken: boolean;
}

/** Keeps a defect in one screen from blanking the page. */
export class Boundary extends Component<{ children: ReactNode }, BoundaryState> {
  override state: BoundaryState = { broken: false };

  static getDerivedStateFromError(): BoundaryState {
    return { broken: true };
  }

  override render() {
    if (!this.state.broken) return this.props.children;
    return (
      <StateBox title="The page itself failed here">
        <p>Nothing on the server is lost. Reload the page; if it fails again, please report what you did.</p>
        <Button variant="default" mt="md" onClick={() => window.location.reload()}>
          Reload
        </Button>
      </StateBox>
    );
  }
}
